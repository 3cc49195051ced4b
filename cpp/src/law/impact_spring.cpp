#include "dashpot/law/impact_spring.hpp"

#include <algorithm>
#include <cmath>

namespace dashpot {

namespace {

// Of a rigid contact under impact: sqrt(k / m) in units of the inverse length of the part, as it
// begins and the largest that no more than 64 micro-steps resolve; and its largest damping ratio,
// of restitution 0.01, for stiffness gives way to its square.
constexpr double kImpactRate = 3.5;
constexpr double kResolvedRate = 7.0;
constexpr double kLargestRatio = 5.0;

}  // namespace

void make_impact_spring(Material& material, double inverse_mass, double length, double stiffness) {
  if (inverse_mass == 0.0) return;
  // N s/m of its own, beside a ratio; at unit stiffness and mass damping is twice its ratio.
  double absolute = material.added_damping, ratio = 0.0;
  if (material.form == DampingForm::kDamping)
    absolute += material.damping;
  else
    ratio = std::min(0.5 * (damping_of(material, 1.0, 1.0) - absolute), kLargestRatio);
  material.form = DampingForm::kRatio;
  material.damping = ratio;
  // Large damping must be resolved too: 2 zeta omega, or d / m, in place of omega.
  material.added_damping = std::min(absolute, kImpactRate / (length * inverse_mass));
  material.rigid = false;
  const double rate = kImpactRate / (length * std::max(1.0, 2.0 * ratio));
  material.stiffness = rate * rate / inverse_mass;
  if (stiffness == 0.0) return;
  const double stiffest = std::pow(kResolvedRate / kImpactRate, 2) * material.stiffness;
  material.stiffness = std::min(stiffest, stiffness);
}

}  // namespace dashpot
