#include "dashpot/islands/solref_load.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dashpot/law/solref.hpp"
#include "dashpot/model/properties.hpp"

namespace dashpot {

namespace {

constexpr double kFollowing = 0.05;  // tau, s
// Fraction of the speed at which the load would swing by all of itself.
constexpr double kStillSpeed = 0.1;
// Radians of its own swing for which a contact at rest was still. A hit turns within 2 kStillSpeed.
constexpr double kStillPhase = 1.0;
// Of the weight: MuJoCo's impedance may vanish with the load, and what lands would find no spring.
constexpr double kLeastPart = 1e-3;
// Loads L under which overlap recovers: with one, what rests would not.
constexpr double kBearable = 2.0;
// By how many times a limit or equality may grow stiffer and count as even: MuJoCo's default does
// so by 2.2 within a millimetre, which steps seldom resolve.
constexpr double kEven = 2.5;
constexpr int kOfPoint = 3;  // rows of a connect
// Of the width: the shortest way over which stiffness is found.
constexpr double kShortestWay = 1e-3;

// Of a limit or an equality, from its row `first` on. All its rows have one kappa.
void read_solref_at_position(const StepView& step, const AlignedDoubles& velocity, size_t first,
                             Rows& rows, std::vector<GroupMaterial>& materials) {
  const ConstraintInput& input = step.constraints[rows.group[first].input];
  if (rows.typical_inverse_mass[rows.group[first].row] == 0.0) return;
  const auto kappa_at = [&](double x) {
    return solref_spring_at(input.solref, input.solimp, x)[0];
  };
  const auto [softest, stiffest] = std::minmax({kappa_at(0.0), kappa_at(input.solimp[2])});
  if (stiffest <= kEven * softest) return;
  double position[kMaxRows], way[kMaxRows], mass[kMaxRows];
  double start = 0.0, end = 0.0, length = 0.0;  // norms, squared until all rows are summed up
  for (int i = 0; i < input.together; ++i) {
    const RowGroup& c = rows.group[first + i];
    const double rate = first_rate(rows, c, velocity);
    const double most = c.is_unilateral() ? 0.0 : std::numeric_limits<double>::infinity();
    const double now = step.constraints[c.input].position;
    position[i] = std::min(now, most);
    way[i] = std::min(now + step.length * rate, most) - position[i];
    mass[i] = 1.0 / rows.typical_inverse_mass[c.row];
    start += position[i] * position[i];
    end += (position[i] + way[i]) * (position[i] + way[i]);
    length += way[i] * way[i];
  }
  start = std::sqrt(start), end = std::sqrt(end), length = std::sqrt(length);
  if (rows.group[first].is_unilateral() && start == 0.0 && end == 0.0) return;
  const double shortest = kShortestWay * input.solimp[2];
  if (length < shortest) {
    end = start + shortest;
    for (int i = 0; i < input.together; ++i)
      way[i] = start > 0.0 ? shortest * position[i] / start : shortest;
  }
  const double at_start = kappa_at(start), at_end = kappa_at(end);
  double work = 0.0, square = 0.0;
  for (int i = 0; i < input.together; ++i) {
    work += mass[i] * way[i] * (at_end * (position[i] + way[i]) - at_start * position[i]);
    square += mass[i] * way[i] * way[i];
  }
  const double stored = solref_energy_at(input.solref, input.solimp, start);
  for (int i = 0; i < input.together; ++i) {
    RowGroup& c = rows.group[first + i];
    GroupMaterial& given = materials[first + i];
    if (start > 0.0) c.stored = mass[i] * stored * std::pow(position[i] / start, 2);
    c.solref.load = at_start * std::abs(position[i]);
    const double turn = at_start * step.length * step.length * rows.inverse_mass[c.row] * mass[i];
    double kappa = std::max(at_start, work / square);
    if ((c.is_unilateral() || input.together > kOfPoint) && stored > 0.0)
      kappa += std::min(1.0, turn) *
               std::max(0.0, 0.5 * at_start * at_start * start * start / stored - kappa);
    given.normalised_stiffness = kappa;
    given.normalised_damping = given.own_damping =
        solref_spring_at(input.solref, input.solimp, 0.5 * (start + end))[1];
  }
}

// Cosine of the angle from which on two pushes press what is between them.
constexpr double kOpposed = -0.5;
constexpr double kAside = 0.5;  // cosine of half that angle

bool follows_solref(const RowGroup& c, const GroupMaterial& given) {
  return c.kind == RowKind::kContact && given.from_solref;
}

double dot(const std::array<double, 3>& a, const std::array<double, 3>& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// By what has the inverse mass `loading`.
void press(const ContactInput& input, const Rows& rows, const RowGroup& c, double loading,
           GroupMaterial& given) {
  const double typical = rows.typical_inverse_mass[c.row];
  if (typical <= 0.0) return;
  const double damping =
      solref_to_spring_at_rest(input.solref, input.solimp, given.load, loading / typical)[1];
  // Rows have delta over sqrt(A w).
  const double scale = std::sqrt(rows.bounded_inverse_mass(c.row) / typical);
  given.normalised_damping = std::max(given.normalised_damping, damping * scale);
  given.is_clamped = true;
}

// A push on a body by a contact, along a unit vector of the world.
struct Push {
  int body, tree;  // what is pushed, and what pushes
  std::array<double, 3> direction;
};

// On the body of one of a contact's geoms, by the other's.
Push push_of(const mjModel_* model, const ContactInput& input, int side) {
  const double sign = side == 0 ? -1.0 : 1.0;
  return {host::moved_body(model, input.geom[side]),
          input.tree[1 - side],
          {sign * input.frame[0], sign * input.frame[1], sign * input.frame[2]}};
}

// All pushes within 60 degrees of their mean, as those on a tray, leave no two that are opposed.
bool any_opposed(const Push* first, const Push* last) {
  std::array<double, 3> mean{};
  for (const Push* push = first; push != last; ++push)
    for (int i = 0; i < 3; ++i) mean[i] += push->direction[i];
  const double length = std::sqrt(dot(mean, mean));
  if (std::all_of(first, last,
                  [&](const Push& push) { return dot(push.direction, mean) > kAside * length; }))
    return false;
  return std::any_of(first, last, [&](const Push& push) {
    return std::any_of(&push + 1, last, [&](const Push& other) {
      return dot(push.direction, other.direction) < kOpposed;
    });
  });
}

// Bodies that contacts push against each other, sorted. Kept: a step allocates nothing.
const std::vector<int>& find_pressed_bodies(const mjModel_* model,
                                            const std::vector<ContactInput>& contacts,
                                            const Rows& rows) {
  thread_local std::vector<Push> pushes;
  thread_local std::vector<int> pressed;
  pushes.clear();
  for (const RowGroup& c : rows.group) {
    if (c.kind != RowKind::kContact || contacts[c.input].gap >= 0.0) continue;
    for (int side = 0; side < 2; ++side) {
      const Push push = push_of(model, contacts[c.input], side);
      if (push.body >= 0) pushes.push_back(push);
    }
  }
  std::sort(pushes.begin(), pushes.end(),
            [](const Push& a, const Push& b) { return a.body < b.body; });
  pressed.clear();
  for (auto first = pushes.begin(), last = first; first != pushes.end(); first = last) {
    last = std::find_if(first, pushes.end(),
                        [&](const Push& push) { return push.body != first->body; });
    if (any_opposed(&*first, &*first + (last - first))) pressed.push_back(first->body);
  }
  return pressed;
}

}  // namespace

bool read_solref_at_load(const StepView& step, const AlignedDoubles& velocity, Rows& rows,
                         std::vector<GroupMaterial>& materials) {
  bool any = false;  // contact
  const double following = -std::expm1(-step.length / kFollowing);
  for (size_t i = 0; i < rows.group.size(); ++i) {
    RowGroup& c = rows.group[i];
    GroupMaterial& given = materials[i];
    if (!given.from_solref) continue;
    if (c.kind != RowKind::kContact) {
      if (c.kind != RowKind::kSlider && step.constraints[c.input].together > 0)
        read_solref_at_position(step, velocity, i, rows, materials);
      continue;
    }
    any = true;
    const ContactInput& input = step.contacts[c.input];
    const double weight = given.load, least = kLeastPart * weight;
    const double typical = rows.typical_inverse_mass[c.row];
    c.solref = {weight, 0.0};
    if (step.matches[i].nearest >= 0) {
      const RememberedContact before = step.memory.contact(step.matches[i].nearest);
      if (before.solref.load > 0.0) c.solref = before.solref;
      const double borne = typical * before.compression * before.stiffness;
      const double frequency = std::sqrt(given.normalised_stiffness);
      const double speed = std::abs(first_rate(rows, c, velocity));
      const bool still = speed * frequency <= kStillSpeed * borne;
      c.solref.still = still ? c.solref.still + step.length : 0.0;
      if (speed * frequency > weight) c.solref.load = std::max(c.solref.load, weight);
      if (c.solref.still * frequency > kStillPhase)
        c.solref.load += following * (std::max(borne, least) - c.solref.load);
    } else if (step.memory.starts() && input.gap < 0.0) {
      c.solref.load = std::clamp(
          -input.gap * solref_spring_at(input.solref, input.solimp, -input.gap)[0], least, weight);
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
  return any;
}

void damp_clamped_bodies(const mjModel_* model, const std::vector<ContactInput>& contacts,
                         const Rows& rows, std::vector<GroupMaterial>& materials) {
  const std::vector<int>& pressed_bodies = find_pressed_bodies(model, contacts, rows);
  if (pressed_bodies.empty()) return;
  const auto is_pressed = [&](int body) {
    return body >= 0 && std::binary_search(pressed_bodies.begin(), pressed_bodies.end(), body);
  };
  for (size_t i = 0; i < rows.group.size(); ++i) {
    const RowGroup& c = rows.group[i];
    if (!follows_solref(c, materials[i])) continue;
    const ContactInput& input = contacts[c.input];
    if (input.gap >= 0.0 || input.tree[0] == input.tree[1]) continue;
    bool pressed = false;
    double loading = 0.0;  // inverse mass of what loads the contact
    for (int side = 0; side < 2; ++side) {
      const Push push = push_of(model, input, side);
      if (!is_pressed(push.body)) continue;
      pressed = true;
      if (!is_pressed(host::moved_body(model, input.geom[1 - side])))
        loading = c.tree[0] == push.tree   ? rows.tree_inverse_mass[c.row][0]
                  : c.tree[1] == push.tree ? rows.tree_inverse_mass[c.row][1]
                                           : 0.0;
    }
    if (pressed) press(input, rows, c, loading, materials[i]);
  }
}

}  // namespace dashpot
