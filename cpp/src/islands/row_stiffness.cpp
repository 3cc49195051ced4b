#include "dashpot/islands/row_stiffness.hpp"

#include <algorithm>
#include <cmath>

namespace dashpot {

namespace {

// Damping ratios that stand for restitution 0, of rigid contacts and of springs: a ratio z leaves
// 1 / (4 z^2) of the speed, 0.03 and 1e-4. Rigid contacts have less, for theirs makes them soft.
constexpr double kRigidInelastic = 3;
constexpr double kInelastic = 50;
// Least fraction of a rigid stiffness that a hit keeps which rows tie to other bodies. With all of
// it an elastic ball welded to 4 kg left with 0.70 of its speed, with this part with 0.98.
constexpr double kSoftestTied = 0.08;
// Largest theta / (c - 1) of a rigid hit with restitution 0. The bound c of three rows differs with
// their heading, by which what was left of a hit differed by up to 5 %; in nearly all this is less.
constexpr double kInelasticResolution = 0.6;

// Inverse mass that rigid rows divide by. A contact row without any cannot be loaded; an
// equality may pass a singular configuration.
double loaded_inverse_mass(const Rows& rows, const RowGroup& c, int row) {
  const bool immobile = c.kind == RowKind::kContact && rows.inverse_mass[row] == 0.0;
  return immobile ? 0.0 : rows.bounded_inverse_mass(row);
}

// Of friction row i and the one beside it, of the two sliding or the two rolling rows, the larger
// inverse mass. The stiffness of rigid rows divides by it, and resolves both.
template <typename InverseMass>
double larger_inverse_mass(const RowGroup& c, int i, InverseMass inverse_mass) {
  if (i == 3) return inverse_mass(c.row + 3);
  const int first = c.row + (i < 3 ? 1 : 4);
  return std::max(inverse_mass(first), inverse_mass(first + 1));
}

// Their mean, which no choice of the tangents changes; where one of them moves nothing, that of the
// other. Springs of a given stiffness are isotropic by it, whatever the tangents are.
template <typename InverseMass>
double mean_inverse_mass(const RowGroup& c, int i, InverseMass inverse_mass) {
  if (i == 3) return inverse_mass(c.row + 3);
  const int first = c.row + (i < 3 ? 1 : 4);
  const double a = inverse_mass(first), b = inverse_mass(first + 1);
  return a == 0.0 || b == 0.0 ? std::max(a, b) : 0.5 * (a + b);
}

// What is asked of a row: kappa (1/s^2) and delta (1/s).
struct Rates {
  double stiffness = 0.0, damping = 0.0;
};

// By which rigid normals have their stiffness. Contacts between two bodies have one: statics leaves
// open how they share a load, and by inverse masses of their own those near the centre of mass
// would take most of it.
double normal_inverse_mass(const Rows& rows, const RowGroup& c) {
  return c.pair_inverse_mass > 0.0 ? c.pair_inverse_mass : loaded_inverse_mass(rows, c, c.row);
}

// Of a group's first row: by its own solref, or by a material in SI units.
Rates given_rates(const Rows& rows, const RowGroup& c, const GroupMaterial& given) {
  if (!given.from_solref) {
    const double w = normal_inverse_mass(rows, c);
    return {rows.stiffness[c.row] * w, rows.damping[c.row] * w};
  }
  const double typical = rows.typical_inverse_mass[c.row];
  const double ratio = typical > 0.0 ? rows.bounded_inverse_mass(c.row) / typical : 1.0;
  return {given.normalised_stiffness * ratio, given.normalised_damping * std::sqrt(ratio)};
}

// Whether stiffness gives way to a group's restitution.
bool keeps_restitution(const GroupMaterial& given) {
  return given.is_rigid() && given.material.form == DampingForm::kRestitution;
}

// The damping ratio that a rigid contact of a given restitution has alone.
double inelastic_ratio(const RowGroup& c, const Material& material) {
  const double ratio = std::min(restitution_to_damping_ratio(material.damping), kRigidInelastic);
  return ratio / std::sqrt(c.pressed);
}

// The damping ratio, by its own inverse mass, to which a rigid row's stiffness gives way, else 0.
double kept_ratio(const RowGroup& c, const GroupMaterial& given) {
  const Material& material = given.material;
  if (keeps_restitution(given)) return inelastic_ratio(c, material) / std::sqrt(c.tied);
  const bool is_tied = c.tied < 1.0 && material.form == DampingForm::kRatio;
  return is_tied ? material.damping / std::sqrt(c.tied) : 0.0;
}

// Fraction of its stiffness that a rigid row keeps whose hit is tied to more than its own mass. On
// one as stiff as the rows that tie it, these would take the energy of the hit with their dampers.
double softened_by_ties(const RowGroup& c) {
  return std::clamp(2.0 * c.tied - 1.0, kSoftestTied, 1.0);
}

// delta that a rigid material asks for at a kappa and an inverse mass w.
double rigid_damping(const RowGroup& c, const Material& material, double kappa, double w) {
  if (material.form == DampingForm::kRestitution)
    return 2.0 * inelastic_ratio(c, material) * std::sqrt(kappa / c.tied);
  return w > 0.0 ? w * damping_of(material, kappa / w, w * c.tied) : 0.0;
}

// Whether a rigid material says how damped it is, rather than in proportion to what is resolved.
bool fixes_damping(const Material& material) {
  return material.form != DampingForm::kRatio || material.added_damping > 0.0;
}

// Of a material in SI units whose restitution is 0 the force of a hit is over in so short a time
// that friction has to be as quick. Two sides combine to a ratio; a pair has what it was given.
double sliding_damping_ratio(const Material& material) {
  const bool inelastic = !material.rigid && (material.form == DampingForm::kRestitution
                                                 ? material.damping == 0.0
                                                 : std::isinf(material.damping));
  return material.tangential_damping_ratio * (inelastic ? kInelastic : 1.0);
}

// By how much the damping ratio of a rigid hit's normal is more than critical, 0 to 2.
double beyond_critical(const RowGroup& c, const GroupMaterial& given) {
  if (!keeps_restitution(given)) return 0.0;
  return std::clamp(inelastic_ratio(c, given.material), 1.0, kRigidInelastic) - 1.0;
}

// Of a contact between two trees with the parts w_1 and w_2 of its inverse mass, the weight of the
// heavier accelerates the lighter by a = g max(w_1, w_2) / min(w_1, w_2). `deflection_time` is that
// of g; the result is that of a.
double loaded_deflection_time(const Rows& rows, const RowGroup& c, double deflection_time) {
  const auto [heavy, light] =
      std::minmax(rows.tree_inverse_mass[c.row][0], rows.tree_inverse_mass[c.row][1]);
  return heavy > 0.0 ? deflection_time * std::sqrt(heavy / light) : deflection_time;
}

// delta of rigid rows whose coupled damping has the bound c, times h, see below.
double most_damped_rigid(double bound) {
  return bound > 1.0 ? kRigidResolution / (bound - 1.0) : std::numeric_limits<double>::infinity();
}

// kappa of a solref whose own damper, more than critical, is not resolved: what is left out of it
// resists as a spring instead, which in the time 1 / delta, in which the rest stops what comes,
// gives way as far as that would. Models ask for what is rigid by damping ratios of hundreds.
double stiffness_for_damper(const Rates& asked, double own_damping, double most_damped) {
  const double critical = 2.0 * std::sqrt(asked.stiffness);
  const double left_out = own_damping - std::max(critical, most_damped);
  return left_out > 0.0 ? asked.stiffness + left_out * most_damped : asked.stiffness;
}

// Longest micro-step that resolves the rates of a model's own solref: no shorter than that of a
// rigid contact, unless this resolves the spring, and only the damper of what is pressed between
// others asks for more.
double longest_solref_microstep(const Rates& asked, const RigidCoupling& coupling, bool is_clamped,
                                double rigid) {
  double of_stiffness = std::numeric_limits<double>::infinity(), of_damping = of_stiffness;
  if (asked.stiffness > 0.0)
    of_stiffness = std::sqrt(stiffest_rigid(coupling.stiffness) / asked.stiffness);
  if (asked.damping > 0.0) of_damping = most_damped_rigid(coupling.normal_damping) / asked.damping;
  if (is_clamped && of_stiffness >= rigid) return std::min(of_stiffness, of_damping);
  return std::max(rigid, std::min(of_stiffness, of_damping));
}

// Longest micro-step in which a rigid material's restitution leaves the stiffness for weights.
double longest_inelastic_microstep(const RowGroup& c, const Material& material,
                                   const RigidCoupling& coupling, double deflection_time) {
  const double zeta = inelastic_ratio(c, material) / std::sqrt(c.tied);
  if (zeta == 0.0) return std::numeric_limits<double>::infinity();
  return most_damped_rigid(coupling.normal_damping) * deflection_time *
         std::sqrt(kInelasticSag / kRigidSag) / (2.0 * zeta);
}

// With the inverse mass w, bounded: k = kappa / w would turn the frozen geometry's error near a
// singular configuration into arbitrary forces.
void fill_row(Rows& rows, int row, double w, double kappa, double delta) {
  const double mass = w > 0.0 ? 1.0 / w : 0.0;
  // Where nothing moves along a row, any positive stiffness carries its zero load.
  rows.stiffness[row] = w > 0.0 ? kappa * mass : 1.0;
  rows.damping[row] = w > 0.0 ? delta * mass : 0.0;
}

// Of sliding rows: kappa and delta that are resolved; and by how much the normal of a rigid hit is
// more than critically damped.
struct SlidingBounds {
  double resolved, most_damped, beyond_critical;
};

// Fills the friction of a group whose normal is filled. Returns whether nothing given was lowered.
bool fill_sliding_rows(Rows& rows, const RowGroup& c, const GroupMaterial& given, bool hit,
                       const SlidingBounds& bounds) {
  const Material& material = given.material;
  const bool is_rigid = given.is_rigid();
  const auto inverse_mass = [&](int row) { return loaded_inverse_mass(rows, c, row); };
  bool as_given = true;
  for (int i = 1; i < c.dim; ++i) {
    const int row = c.row + i;
    const double w = inverse_mass(row), mean = mean_inverse_mass(c, i, inverse_mass);
    const double of_mean = w > 0.0 && (!is_rigid || hit) ? w / mean : 1.0;
    const double of_resolved =
        hit || w == 0.0 ? of_mean : w / larger_inverse_mass(c, i, inverse_mass);
    double asked = std::numeric_limits<double>::infinity();
    if (given.has_si_stiffness()) asked = rows.stiffness[row] * w;
    if (is_rigid && hit)
      asked = material.tangential_ratio * rows.stiffness[c.row] *
              mean_inverse_mass(c, 1, inverse_mass) * of_mean;
    // The force of the normal is over before friction as damped as it has stopped what the two move
    // together, and a foot slides back with 0.2 of its speed; twice as damped, with 0.01 to 0.05.
    const double zeta = (1.0 + 2.0 * bounds.beyond_critical) * sliding_damping_ratio(material);
    const double most_damped = bounds.most_damped * of_mean;
    double kappa = std::min(asked, bounds.resolved * of_resolved);
    if (bounds.beyond_critical > 0.0 && zeta > 0.0)
      kappa = std::min(kappa, std::pow(most_damped / (2.0 * zeta), 2) / of_mean);
    const double delta = 2.0 * zeta * std::sqrt(kappa * of_mean);
    if (given.has_si_stiffness())
      as_given = as_given && fits(asked, bounds.resolved * of_resolved) && fits(delta, most_damped);
    fill_row(rows, row, w, kappa, std::min(delta, most_damped));
  }
  return as_given;
}

}  // namespace

double stiffest_rigid(double bound) {
  const double coupling = std::max(0.0, bound - 1.0);
  return std::min(kStiffestAlone,
                  coupling > 0.0 ? kRigidResolution * kRigidResolution / coupling : kStiffestAlone);
}

void fill_given_rows(Rows& rows, const RowGroup& c, const Material& material) {
  const int n = c.row;
  const double w_normal = c.pair_inverse_mass > 0.0 ? c.pair_inverse_mass : rows.inverse_mass[n];
  rows.stiffness[n] = material.stiffness;
  const double damping =
      w_normal > 0.0 ? damping_of(material, material.stiffness, w_normal * c.pressed * c.tied)
                     : 0.0;
  rows.damping[n] = std::isfinite(damping)
                        ? damping
                        : 2.0 * kInelastic * std::sqrt(material.stiffness / w_normal);
  if (c.dim == 1) return;
  const double tangential = material.tangential_ratio * rows.stiffness[n];
  const auto inverse_mass = [&](int row) { return rows.inverse_mass[row]; };
  // What cannot slide, as a spindle, can turn: it does as what slides like the normal would.
  const double sliding_inverse_mass = std::max(w_normal, mean_inverse_mass(c, 1, inverse_mass));
  for (int i = 1; i < c.dim; ++i) {
    const double mean = mean_inverse_mass(c, i, inverse_mass);
    const double k = i < 3 || mean == 0.0 ? tangential : tangential * sliding_inverse_mass / mean;
    rows.stiffness[n + i] = k;
    rows.damping[n + i] = rows.inverse_mass[n + i] == 0.0
                              ? 0.0
                              : 2.0 * sliding_damping_ratio(material) * std::sqrt(k / mean);
  }
}

bool fill_rigid_rows(Rows& rows, const RowGroup& c, const GroupMaterial& given,
                     const RigidCoupling& coupling, const DeflectionTime& deflection_time,
                     const RigidMicrostep& microstep) {
  const Material& material = given.material;
  const double w = normal_inverse_mass(rows, c);
  const bool is_rigid = given.is_rigid();
  const Rates asked = is_rigid ? Rates() : given_rates(rows, c, given);
  const double h = microstep.duration;
  const double resolved =
      stiffest_rigid(coupling.stiffness) / (microstep.of_stiffness * microstep.of_stiffness);
  const bool is_rigid_hit = is_rigid && microstep.hit;
  const double beyond = is_rigid_hit ? beyond_critical(c, given) : 0.0;
  const double most = kInelasticResolution * (kRigidInelastic - 1.0) / beyond;
  const double most_damped_sliding =
      std::min(most_damped_rigid(coupling.friction_damping), most) / h;
  const double most_damped = c.kind == RowKind::kSlider
                                 ? most_damped_sliding
                                 : std::min(most_damped_rigid(coupling.normal_damping), most) / h;
  double stiffest = resolved;
  if (given.from_solref) {
    const double own_damping = given.normalised_damping > 0.0
                                   ? asked.damping * given.own_damping / given.normalised_damping
                                   : 0.0;
    stiffest = std::min(resolved, stiffness_for_damper(asked, own_damping, most_damped));
  } else if (given.has_si_stiffness()) {
    stiffest = std::min(resolved, asked.stiffness);
  }
  double kappa = stiffest, delta = asked.damping;
  bool as_given = fits(asked.stiffness, resolved);
  if (given.has_si_stiffness() && asked.stiffness > 0.0)
    delta *= std::sqrt(kappa / asked.stiffness);
  if (is_rigid) {
    const double zeta = kept_ratio(c, given);
    if (zeta > 0.0 || c.tied < 1.0) {
      const RowGroup& first = rows.group[c.first_of_pair];
      const double bearing =
          kRigidSag / kInelasticSag /
          std::pow(loaded_deflection_time(rows, first, deflection_time.weight), 2);
      const double holding = 1.0 / std::pow(deflection_time.dry_friction, 2);
      const double tied = softened_by_ties(c) * kappa;
      const double damped = zeta > 0.0 ? std::pow(most_damped / (2.0 * zeta), 2) : tied;
      // What is tied rests on its full stiffness once it is no longer thrown.
      const double least = c.tied * std::max(bearing, holding);
      kappa = std::min(kappa, std::max(std::min(damped, tied), least));
    }
    delta = rigid_damping(c, material, kappa, w);
  }
  if (!is_rigid || fixes_damping(material)) as_given = as_given && fits(delta, most_damped);
  fill_row(rows, c.row, w, kappa, std::min(delta, most_damped));
  const double resolved_sliding =
      is_rigid_hit ? stiffest_rigid(coupling.stiffness) / (h * h) : resolved;
  const bool slides_as_given = fill_sliding_rows(rows, c, given, microstep.hit,
                                                 {resolved_sliding, most_damped_sliding, beyond});
  return as_given && slides_as_given;
}

double longest_rigid_microstep(const Rows& rows, const RowGroup& c, const GroupMaterial& given,
                               const RigidCoupling& coupling,
                               const DeflectionTime& deflection_time) {
  double longest = kRigidMicrostep;
  const double sag = loaded_deflection_time(rows, c, deflection_time.weight);
  // h^2 <= kappa h^2 sag / a
  if (c.tree[0] >= 0 && c.tree[1] >= 0)
    longest = std::min(longest,
                       std::max(std::min(sag, deflection_time.dry_friction), deflection_time.load) *
                           std::sqrt(stiffest_rigid(coupling.stiffness)));
  if (keeps_restitution(given))
    longest = std::min(longest, longest_inelastic_microstep(c, given.material, coupling, sag));
  if (given.from_solref)
    longest =
        longest_solref_microstep(given_rates(rows, c, given), coupling, given.is_clamped, longest);
  return longest;
}

}  // namespace dashpot
