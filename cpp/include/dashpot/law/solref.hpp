// MuJoCo's solref and solimp, and the springs that they mean.
//
// MuJoCo's row (documentation, "Solver parameters") of deformation x > 0, rate v and estimated
// inverse mass A has, at its impedance d(x), the regularisation R = (1 - d) A / d and the force
//
//     f = (a_ref - a) / R ,    a_ref = -b v - d k x ,
//
// a: its acceleration, k and b: the numbers of solref_to_spring. A load F at rest deforms it by
//
//     x = (1 - d) A F / (d^2 k) ,
//
// and without a load a mass 1/A swings with x'' = -d b v - d^2 k x, at the damping ratio
// zeta = b / (2 sqrt k). No spring and damper does both: to the mass 1/A the row adds an inertia
// d / ((1 - d) A). A spring and damper without that inertia,
//
//     kappa = d^2 k / (1 - d) ,    delta = d b / sqrt(1 - d) ,    both over A ,
//
// deforms as far under the load for which d is found and keeps zeta, hence the restitution, and
// swings 1 / sqrt(1 - d) times as fast. A motion whose inverse mass is the fraction p of A has the
// ratio b / (2 sqrt(d k (1 + R / (p A)))) in MuJoCo, and here with the damper
//
//     d b / sqrt((1 - d) (1 - d (1 - p)))     over A .

#pragma once

#include <array>

namespace dashpot {

// MuJoCo's impedance at a gap (m or rad), solimp = (d_0, d_width, width, midpoint, power). As in
// MuJoCo, impedances and midpoint are clipped to [1e-4, 0.9999], powers to >= 1, and the impedance
// is the mean of its ends where width is 0.
double impedance(const std::array<double, 5>& solimp, double gap);

// Mass-normalised stiffness k (1/s^2) and damping b (1/s) of a solref pair (timeconst, dampratio)
// or (-stiffness, -damping) and solimp's d_width in (0, 1]: what MuJoCo writes to efc_KBIP. Throws
// std::invalid_argument for other pairs and widths.
std::array<double, 2> solref_to_spring(double ref0, double ref1, double impedance_width);

// kappa (1/s^2) and the damper (1/s) for the fraction p >= 0, delta for 1, at the impedance that a
// row has at rest under a load A F (m/s^2 or rad/s^2, > 0 or infinite). Throws as solref_to_spring.
std::array<double, 2> solref_to_spring_at_rest(const std::array<double, 2>& solref,
                                               const std::array<double, 5>& solimp, double load,
                                               double part = 1.0);

// kappa (1/s^2) and delta (1/s) of a row that rests at a deformation x >= 0 (m or rad), under the
// load A F = kappa x; and A times the energy that it has stored on its way there, m^2/s^2.
std::array<double, 2> solref_spring_at(const std::array<double, 2>& solref,
                                       const std::array<double, 5>& solimp, double deformation);
double solref_energy_at(const std::array<double, 2>& solref, const std::array<double, 5>& solimp,
                        double deformation);

}  // namespace dashpot
