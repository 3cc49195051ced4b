// What a step throws where motion or forces have diverged.

#pragma once

#include <stdexcept>

namespace dashpot {

// Numbers beyond what MuJoCo itself calls diverged, or NaN, named by the tree or degree of freedom.
// Data are as they were before the step.
struct DivergenceError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace dashpot
