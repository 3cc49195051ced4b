// The contact laws that the engine knows.

#pragma once

namespace dashpot {

enum class Law {
  kKelvinVoigt,  // kelvin_voigt.hpp and friction.hpp, in micro-steps
  kComFree       // comfree.hpp, one update per step
};

}  // namespace dashpot
