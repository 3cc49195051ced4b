// Numbers in messages.

#pragma once

#include <sstream>
#include <string>

namespace dashpot {

// A number as text of six digits at most.
inline std::string text(double value) {
  std::ostringstream stream;
  stream << value;
  return stream.str();
}

}  // namespace dashpot
