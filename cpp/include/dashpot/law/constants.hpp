// Numbers of mathematics.

#pragma once

namespace dashpot {

inline constexpr double kPi = 3.14159265358979323846;

}  // namespace dashpot
