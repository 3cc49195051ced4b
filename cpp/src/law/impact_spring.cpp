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
  // At unit stiffness and mass the damping is twice its ratio.
  const double ratio = std::min(0.5 * damping_of(material, 1.0, 1.0), kLargestRatio);
  material.form = DampingForm::kRatio;
  material.damping = ratio;
  material.added_damping = 0.0;
  material.rigid = false;
  // Large damping must be resolved too: 2 zeta omega in place of omega.
  const double rate = kImpactRate / (length * std::max(1.0, 2.0 * ratio));
  material.stiffness = rate * rate / inverse_mass;
  if (stiffness == 0.0) return;
  const double stiffest = std::pow(kResolvedRate / kImpactRate, 2) * material.stiffness;
  material.stiffness = std::min(stiffest, stiffness);
}

}  // namespace dashpot
