// Islands and the control of their micro-steps.
//
// Groups with a tree in common are coupled; an island is a connected set of them. Its micro-step
// h must resolve the coupled stiffness and damping (DESIGN section 2.4):
//
//     h sqrt(lambda_max(K^1/2 A K^1/2)) <= theta,    h lambda_max(D^1/2 A D^1/2) <= theta,
//     A = J inv(H) J' = Jw Jw',   theta = 1/2 .
//
// Upper bound on lambda_max. With K = diag(k), (a + b)^2 <= (1 + |b|/|a|) a^2 + (1 + |a|/|b|) b^2
// splits a row between its two trees T, so
//
//     lambda_max <= max_T lambda_max(S_T),   S_T = sum_r k_r (1 + |Jw_r^other|/|Jw_r^T|)
//                                                        Jw_r^T' Jw_r^T ,
//
// and lambda_max(S_T) <= |S_T^4|_F^(1/4) for small trees, <= min(|S_T|_F, |S_T|_inf) for large.

#pragma once

#include <vector>

#include "dashpot/engine.hpp"
#include "dashpot/microstep.hpp"
#include "dashpot/rows.hpp"

namespace dashpot {

inline constexpr double kResolution = 0.5;         // theta
inline constexpr double kRigidResolution = 0.8;    // theta of rigid rows, see fill_rigid_rows
inline constexpr int kMinimumMicrosteps = 16;      // of "auto"
inline constexpr double kRigidMicrostep = 2.0e-4;  // s, longest micro-step of rigid contacts

// What gives a group its stiffness and damping: a material, or a mass-normalised spring-damper
// k = s / w, d = c / w (MuJoCo's solref).
struct GroupMaterial {
  Material material;
  bool mass_normalised = false;
  double normalised_stiffness = 0.0;  // s, 1/s^2
  double normalised_damping = 0.0;    // c, 1/s

  bool rigid() const { return !mass_normalised && material.rigid; }
};

// Connected sets of groups in a fixed order: by their first group.
std::vector<Island> find_islands(const Rows& rows, const Trees& trees);

// Chooses the number of micro-steps of an island over a step of length `step` (s) and fills the
// stiffness and damping of its rows from `materials` (one per group). A rigid material becomes as
// stiff as h resolves; values that h does not resolve are lowered and counted as clipped.
void plan_microsteps(Island& island, Rows& rows, const Trees& trees,
                     const std::vector<GroupMaterial>& materials, double step,
                     const Options& options);

}  // namespace dashpot
