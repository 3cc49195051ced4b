// Limit surface of friction and the return to it.
//
// Up to five friction directions (2 sliding, 1 torsional, 2 rolling) share one elliptic limit
// surface, scaled by the normal impulse p_n >= 0:
//
//     sum_i (p_i / mu_i)^2 <= p_n^2 .
//
// A direction is a spring-damper of elastic displacement s in series with a slider. Its trial
// impulse t comes from the spring-damper's closed-form flow. Outside the surface the slider slips
// along the surface's normal, the direction that dissipates most: at the rate gamma p_i / mu_i^2,
// gamma >= 0. With c_i, the impulse per unit of rate that the spring-damper answers with,
//
//     p_i = t_i - gamma c_i p_i / mu_i^2 ,   so   p_i = t_i / (1 + gamma c_i / mu_i^2) ,
//
// and gamma is where p meets the surface. Where all c_i / mu_i^2 agree this scales t back along the
// ray to the origin. Sliding then opposes the slip velocity whatever the apparent masses, and a
// wheel whose rolling friction slips still rolls.
//
// The coefficients may be lower under load: p_n above is then p_n m(f), of the normal force f, its
// mean p_n / h over a micro-step, with
//
//     m(f) = s + (1 - s) / (1 + f / F) ,   0 < s <= 1 ,   F > 0 .
//
// From 1 at light load m falls to s at heavy load, half of the way at f = F. The limit mu f m(f)
// grows with f all the same: it is Coulomb friction s mu f and a part that saturates at
// (1 - s) mu F, as that of adhesion does (Derjaguin's law).

#pragma once

namespace dashpot {

inline constexpr int kMaxFrictionDirections = 5;

// Newton's iteration gets within this of the surface in 1 to 3 rounds; more only where responses
// differ by many orders of magnitude.
inline constexpr double kOnSurface = 1e-9;
inline constexpr int kMaxRounds = 64;

// m(f): what a normal force f (N, >= 0) leaves of the coefficients; s in (0, 1] and F (N, > 0).
double share_under_load(double s, double F, double normal_force);

// Returns the factor in [0, 1] that brings impulse[0..n) onto or inside the limit surface; 1
// inside. mu[i] >= 0 (dimensionless for sliding, m for torsion and rolling); mu[i] = 0 admits no
// impulse in direction i, whose component must be zeroed by the caller.
double radial_return(const double* impulse, const double* mu, int n, double normal_impulse);

// Brings impulse[0..n) onto or inside the limit surface as above; true if nothing had to slip.
// response[i] = c_i >= 0, whose proportions alone matter. Directions with mu[i] = 0 carry nothing.
bool return_to_limit(double* impulse, const double* mu, const double* response, int n,
                     double normal_impulse);

}  // namespace dashpot
