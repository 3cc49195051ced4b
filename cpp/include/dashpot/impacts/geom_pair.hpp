#pragma once

#include <array>

namespace dashpot {

using GeomPair = std::array<int, 2>;

}  // namespace dashpot
