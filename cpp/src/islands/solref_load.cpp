#include "dashpot/islands/solref_load.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/law/solref.hpp"

namespace dashpot {

namespace {

constexpr double kFollowing = 0.05;  // tau, s
// Fraction of the speed at which the load would swing by all of itself.
constexpr double kStillSpeed = 0.1;
// For how long a contact has been still that bears what it bears: radians of its own swing. A hit
// turns round within 2 kStillSpeed.
constexpr double kStillPhase = 1.0;
// Of the weight: MuJoCo's impedance may go to nothing with the load, and what then lands on the
// contact would find no spring.
constexpr double kLeastPart = 0.1;
// Loads L under which overlap recovers: with one, what rests would not.
constexpr double kBearable = 2.0;

}  // namespace

void read_solref_at_load(const StepView& step, const double* velocity, Rows& rows,
                         std::vector<GroupMaterial>& materials) {
  const double following = -std::expm1(-step.length / kFollowing);
  for (size_t i = 0; i < rows.group.size(); ++i) {
    RowGroup& c = rows.group[i];
    GroupMaterial& given = materials[i];
    if (c.kind != RowKind::kContact || !given.from_solref) continue;
    const ContactInput& input = step.contacts[c.input];
    const double weight = given.load, least = kLeastPart * weight;
    const double typical = rows.typical_inverse_mass[c.row];
    c.solref = {weight, 0.0};
    if (step.matches[i].nearest >= 0) {
      const RememberedContact before = step.memory.contact(step.matches[i].nearest);
      if (before.solref.load > 0.0) c.solref = before.solref;
      const double borne = typical * before.compression * before.stiffness;
      const double frequency = std::sqrt(given.normalised_stiffness);
      double rate[kMaxRows];
      gather(rows, c, velocity, rate);
      const bool still = std::abs(rate[0]) * frequency <= kStillSpeed * borne;
      c.solref.still = still ? c.solref.still + step.length : 0.0;
      if (c.solref.still * frequency > kStillPhase)
        c.solref.load += following * (std::max(borne, least) - c.solref.load);
    } else if (step.memory.starts() && input.gap < 0.0) {
      c.solref.load =
          std::clamp(solref_load_at_rest(input.solref, input.solimp, -input.gap), least, weight);
    }
    if (typical > 0.0) c.soft_load = kBearable * c.solref.load / typical;
    if (c.solref.load == weight) continue;
    const GroupMaterial at_weight = given;
    given = solref_material(input.solref, input.solimp, c.solref.load);
    if (c.solref.load > weight) {
      given.normalised_damping = std::min(given.normalised_damping, at_weight.normalised_damping);
      given.own_damping = std::min(given.own_damping, at_weight.own_damping);
    }
  }
}

}  // namespace dashpot
