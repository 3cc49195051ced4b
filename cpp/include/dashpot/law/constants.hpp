// Numbers of mathematics and of physics.

#pragma once

namespace dashpot {

inline constexpr double kPi = 3.14159265358979323846;
inline constexpr double kStandardGravity = 9.80665;  // m/s^2

}  // namespace dashpot
