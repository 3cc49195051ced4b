#include "dashpot/impacts/middle.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "dashpot/law/material.hpp"

namespace dashpot {

namespace {

// Of a rigid contact under impact: sqrt(k / m) in units of the inverse length of the substep, as it
// begins and the largest that no more than 64 micro-steps resolve; and its largest damping ratio,
// of restitution 0.01, for stiffness gives way to its square.
constexpr double kImpactRate = 3.5;
constexpr double kResolvedRate = 7.0;
constexpr double kLargestRatio = 5.0;

// Turns a rigid material into the spring of an impact, seen by a contact of apparent inverse mass w
// (1/kg) in a substep of `length` (s): undamped contact would last pi sqrt(m / k) = 0.9 of the
// substep. A contact that is compressed with `stiffness` (N/m, 0 for none) keeps it as far as
// micro-steps of the substep resolve it.
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

}  // namespace

void give_back_way(const Rows& rows, const RowData& data, double length,
                   const std::vector<ConstraintInput>& start_constraints,
                   std::vector<ContactInput>& contacts, std::vector<ConstraintInput>& constraints) {
  for (const RowGroup& c : rows.group) {
    const double load = first_rate(rows, c, data.smooth_acceleration) + c.surface_acceleration[0];
    const double way = 0.5 * length * (first_rate(rows, c, data.velocity) + 0.25 * length * load);
    if (c.kind == RowKind::kContact) {
      contacts[c.input].gap -= way;
      continue;
    }
    ConstraintInput& constraint = constraints[c.input];
    constraint.position -= way;
    for (const ConstraintInput& same : start_constraints)
      if (same.memory == constraint.memory) constraint.position = same.position;
  }
}

void give_rigid_impacts_springs(const Memory& memory, const std::vector<GeomPair>& impact,
                                const std::vector<ContactInput>& contacts, const Rows& rows,
                                double length, std::vector<GroupMaterial>& materials) {
  std::map<GeomPair, double> compressed;
  for (int i = 0; i < memory.contact_count(); ++i) {
    const RememberedContact contact = memory.contact(i);
    double& stiffness = compressed[{int(contact.geom[0]), int(contact.geom[1])}];
    stiffness = std::max(stiffness, contact.stiffness);
  }
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (c.kind != RowKind::kContact || !materials[i].is_rigid()) continue;
    const GeomPair& pair = contacts[c.input].geom;
    if (!std::binary_search(impact.begin(), impact.end(), pair)) continue;
    const auto before = compressed.find(pair);
    make_impact_spring(materials[i].material, rows.inverse_mass[c.row], length,
                       before == compressed.end() ? 0.0 : before->second);
  }
}

}  // namespace dashpot
