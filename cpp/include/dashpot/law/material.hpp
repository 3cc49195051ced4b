// Contact materials in SI units, their combination, and conversions between the ways to give
// damping. Equations and sources are at the top of material.cpp.

#pragma once

#include <array>

namespace dashpot {

// How the damping of a material is given.
enum class DampingForm {
  kRatio,        // damping ratio zeta = d / (2 sqrt(k m)), m = 1/w the pair's apparent mass; >= 0
  kDamping,      // d, N s/m; >= 0
  kRestitution,  // exact coefficient of restitution without pulling; in [0, 1]
};

// What a material or a pair fixes of a contact. NaN in `friction` means: as the MJCF says.
struct Material {
  bool from_model = false;  // nobody set it: rigid, or the solref that the model itself sets
  bool rigid = true;        // as stiff as the micro-step resolves; `stiffness` unused
  double stiffness = 0.0;   // k, N/m, > 0
  DampingForm form = DampingForm::kRatio;
  double damping = 1.0;        // in the unit of `form`
  double added_damping = 0.0;  // N s/m on top, >= 0: set by combine() for a mixed pair only
  bool has_friction = false;   // overrides the MJCF friction
  std::array<double, 3> friction{1.0, 0.005, 0.0001};  // sliding (1), torsional (m), rolling (m)
  double loaded_friction = 1.0;   // share of friction left under heavy load, in (0, 1]
  double friction_load = 10.0;    // N, > 0, where half of the loss is reached (friction.hpp)
  double tangential_ratio = 1.0;  // tangential over normal stiffness, > 0
  double tangential_damping_ratio = 1.0;  // zeta of the friction springs, >= 0 (row_stiffness.hpp)
};

// Rules by which two materials make one contact.
enum class StiffnessRule { kSeries, kMin, kMax, kMean };
enum class DampingRule { kSeries, kMin, kMax, kMean };
enum class FrictionRule { kMax, kMin, kMean, kGeometricMean };
struct CombinationRules {
  StiffnessRule stiffness = StiffnessRule::kSeries;
  DampingRule damping = DampingRule::kSeries;
  FrictionRule friction = FrictionRule::kMax;  // MuJoCo's
};

// Combines two materials. Symmetric: combine(a, b) == combine(b, a). The pair's damping comes as
// kRatio or kDamping, never as kRestitution, so that damping_of() of a pair is cheap; equations in
// material.cpp. Where only one side overrides friction, the other side's `friction` must hold its
// geom's MJCF values; a NaN yields to the other side's number. Throws std::invalid_argument if
// rules.damping is kMin or kMax and one side gives N s/m, the other a ratio or restitution, unless
// one of them is rigid or that of a geom that nobody set, beside which the other's is whole.
Material combine(const Material& a, const Material& b, const CombinationRules& rules);

// Exact restitution of a Kelvin-Voigt contact that releases at zero force (no pulling), without
// load, as a function of the damping ratio zeta >= 0; and its inverse, e in [0, 1].
// restitution 0 is reached only as zeta -> infinity: restitution_to_damping_ratio(0) returns
// +infinity, which callers map to the largest damping that they resolve.
double damping_ratio_to_restitution(double damping_ratio);
double restitution_to_damping_ratio(double restitution);

// d (N s/m) of a material at stiffness k (N/m) and apparent inverse mass w (1/kg).
double damping_of(const Material& material, double stiffness, double inverse_mass);

}  // namespace dashpot
