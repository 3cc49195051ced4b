// The complementarity-free contact update of ComFree-Sim (Borse, Xie, Huang, Jin, arXiv
// 2603.12185), for comparison and drop-in use.
//
// A contact in overlap, with gap g < 0 (m), rates u_n, u_i of its normal and friction rows and
// friction coefficients mu_i, has a pair of facets for every friction row: two sliding, one
// torsional, two rolling. Each facet pushes on its own, against the rate v_p predicted for the end
// of the step of length dt, which is the rate that smooth forces alone would lead to:
//
//     facet    J_n +- mu_i J_i        (a contact without friction, and a limit: J_n alone)
//     f   = max(0, m (-d v_p - k (g + dt v_p))),      k = k_user / dt,   d = d_user / dt
//     v_p = u_n +- mu_i u_i           with u = J (v + dt a_smooth)
//     m   = imp / ((1 - imp) w_0)
//
// k_user is in 1/s, d_user has no unit, m is in kg (kg m^2 for a hinge's limit). w_0 is MuJoCo's
// estimate of the normal row's inverse mass (body_invweight0, dof_invweight0) and imp its
// impedance at the gap, with solimp = (d_0, d_width, width, midpoint, power):
//
//     imp = d_0 + y(|g| / width) (d_width - d_0),
//     y(x) = x^power / midpoint^(power - 1)                     for x <= midpoint
//            1 - (1 - x)^power / (1 - midpoint)^(power - 1)     up to x = 1, then 1 .
//
// The rows of the contact carry f_n = sum f and f_i = mu_i (f_i+ - f_i-), which lie in the pyramid
// sum |f_i| / mu_i <= f_n. No facet knows of another, nothing iterates, and the next step
// remembers nothing: velocity advances by dt (a_smooth + inv(M) J' f), position by dt times the new
// velocity, as MuJoCo's semi-implicit integrators do.
//
// Statics. N facets with normals along gravity, of effective mass m each, carry a resting body of
// mass M (v_p = -dt g_0) at the depth
//
//     -g = dt (M g_0 / (N m) - (d_user + k_user dt) g_0) / k_user ,
//
// which grows with dt. Friction vanishes with the rate: there is no stiction, and a box on a slope
// of angle a creeps at v_p = M g_0 sin(a) / (2 mu^2 m (d + k dt)) per contact and row.
//
// Stability. The update is explicit: N facets of mass m on a body of mass M need about
// (N m / M) (d_user + k_user dt) < 2, which few of the values of k_user and d_user far above the
// defaults satisfy. Nothing lowers them.
//
// Other rows have the same form, one row each. Limits are facets. Equalities push both ways: the
// maximum is left out, and g is their error. w_0 knows nothing of arms. Where m would throw an
// equality apart, it is lowered to 1 / (S_i (d_user + k_user dt)). Dry friction has no gap: it is
// the damper that stops its row within the step, d_user = 1 and m = 1 / W, up to its limit L,
//
//     f_i = clamp(-v_p / (dt W_i), -L_i, L_i),    W_i = max(w_i, s S_i),  s = 0.55,
//     S_i = sum_j |J_i| |inv(H)| |J_j|' >= sum_j |A_ij|,      j being all that push both ways.
//
// So a row alone holds whatever smooth force is below L. Dry friction that is coupled takes energy,
// never gives it: p' v_p >= sum W_i p_i^2 with p = dt f, and by Gershgorin
// p' A p / 2 <= sum W_i p_i^2 / (2 s). A chain of light links then creeps about as fast as in
// MuJoCo. What contacts, limits and equalities push in a step, dry friction stops in the next one.
//
// Where the authors' program departs from the equations, this follows the equations: the program
// fixes width at 0.01 m, leaves margins out of the gap, and lets equalities and dry friction push
// one way only. As there, only what overlaps at the start of a step pushes one way.

#pragma once

#include <vector>

#include "dashpot/rows/row_data.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

struct ComFree {
  double stiffness = 0.2;  // k_user, 1/s, > 0
  double damping = 0.001;  // d_user, >= 0
};

// m of a facet. Regularised as in MuJoCo, so that it is finite where `inverse_mass` is 0.
double effective_mass(double impedance, double inverse_mass);

// One update of all groups over a step (s). `gap` (m, rad), the error of an equality, and `mass`
// have one entry per group. Leaves in `data` the velocity at the end of the step, impulses, which
// groups touched, and the work of the impulses, p (u_0 + u_1) / 2 for each row.
void update_complementarity_free(const ComFree& law, const Rows& rows, const Trees& trees,
                                 const std::vector<double>& gap, const std::vector<double>& mass,
                                 double step, RowData& data);

}  // namespace dashpot
