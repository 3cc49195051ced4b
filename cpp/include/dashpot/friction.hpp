// Limit surface of friction and its radial return.
//
// Up to five friction directions (2 sliding, 1 torsional, 2 rolling) share one elliptic limit
// surface, scaled by the normal impulse p_n >= 0:
//
//     sum_i (p_i / mu_i)^2 <= p_n^2 .
//
// A direction is a spring-damper of elastic displacement s in series with a slider. Its trial
// impulse comes from the spring-damper's closed-form flow; outside the surface the impulses are
// scaled back along the ray to the origin and s is reset so that the spring alone carries the
// limit: s_i = -p_i / (k_i h).

#pragma once

namespace dashpot {

inline constexpr int kMaxFrictionDirections = 5;

// Returns the factor in [0, 1] that brings impulse[0..n) onto or inside the limit surface; 1
// inside. mu[i] >= 0 (dimensionless for sliding, m for torsion and rolling); mu[i] = 0 admits no
// impulse in direction i, whose component must be zeroed by the caller.
double radial_return(const double* impulse, const double* mu, int n, double normal_impulse);

}  // namespace dashpot
