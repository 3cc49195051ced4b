#include "dashpot/rows/recall.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "dashpot/law/constants.hpp"
#include "dashpot/rows/hit.hpp"
#include "dashpot/rows/memory.hpp"

namespace dashpot {

namespace {

// That of a hundred weights, as contacts of SI stiffness bear, m/s^2; of rotations the same number.
constexpr double kBearableAcceleration = 100.0 * kStandardGravity;
constexpr double kElasticRatio = 0.2;  // of damping, see is_elastic()
constexpr int kContactsAtOnce = 64;    // by a thread
// Fraction of a step up to which the time that a contact is frozen at is that of the middle.
constexpr double kMiddle = 0.03;
// Part of its turn by which that of a contact changes in a step at most if it goes on steadily.
constexpr double kSteadyTurning = 0.4;
// (omega H)^2 of an equality on a model's own solref up to which its spring has the position for
// its deformation. What rows and position differ by has either sign: where the smaller counted, a
// weld at 22 rad/s lost 2 % of its energy in 5 s at 1 ms. Stiffer ones would take it for force.
constexpr double kSoftEquality = 1.0;
constexpr double kRounding = 1e-9;  // relative, of stiffness by inverse mass

// Whether a limit or equality of which nothing is remembered, and whose solref the model sets,
// begins with what its spring bears: an equality, which users switch on, in any step, a limit in
// the first of all.
bool begins_stretched(const Memory& memory, const ConstraintInput& input, const RowGroup& c) {
  return input.has_solref && (c.kind == RowKind::kBilateral || memory.starts());
}

// Where the springs of limits and equalities are by their positions: of those that grow stiffer on
// their way, where one as stiff as the row bears the load that belongs to the position
// (islands/solref_load.hpp). They store what they took from bodies, and what they had lost before,
// but no more: where steps do not resolve how they grow stiffer nothing is gained.
//
// The position (m or rad) of a spring, and the energy (J) that this stands for.
struct SpringPlace {
  double position, stored;
};

// One that steps do not resolve has its own position, and a load of its own.
SpringPlace place_of_spring(const ConstraintInput& input, const Rows& rows, const RowGroup& c) {
  const double x = input.position, k = rows.stiffness[c.row];
  const double bears = c.solref.load / (rows.typical_inverse_mass[c.row] * k);
  const bool resolved = c.solref.load > 0.0 && bears <= (1.0 + kRounding) * std::abs(x);
  return {resolved ? std::copysign(bears, x) : x, resolved ? c.stored : 0.5 * k * x * x};
}

// Whether rows that have one impedance, from group `first` on, grow stiffer on their way.
bool grows_stiffer(const StepView& step, const Rows& rows, size_t first) {
  const auto begin = rows.group.begin() + first;
  return std::any_of(begin, begin + step.constraints[begin->input].together,
                     [](const RowGroup& c) { return c.solref.load > 0.0; });
}

// What part of their places they may be deformed by; the `energy_tank` (J) left of what they lost.
double part_of_places(const StepView& step, const Rows& rows, size_t first, double& energy_tank) {
  double stored = 0.0, remembered = 0.0;
  for (int i = 0; i < step.constraints[rows.group[first].input].together; ++i) {
    const RowGroup& c = rows.group[first + i];
    const ConstraintInput& input = step.constraints[c.input];
    const RememberedConstraint old = step.memory.constraint(input.memory);
    if (old.stiffness == 0.0 && begins_stretched(step.memory, input, c)) return 1.0;
    stored += place_of_spring(input, rows, c).stored;
    remembered += 0.5 * old.stiffness * old.deformation * old.deformation + old.beyond;
  }
  energy_tank = std::min(energy_tank, std::max(0.0, remembered)) + remembered - stored;
  if (energy_tank >= 0.0 || stored <= 0.0) return 1.0;
  const double left = std::max(0.0, stored + energy_tank);
  energy_tank = std::min(0.0, stored + energy_tank);
  return std::sqrt(left / stored);
}

// Component of `local` (frame of geom 1) along a world direction.
double along(const double* local, const std::array<double, 9>& rotation, const double* direction) {
  double sum = 0.0;
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i) sum += local[i] * rotation[3 * j + i] * direction[j];
  return sum;
}

double norm(const double* v) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

// Factor on what a row remembers of a deformation under another stiffness. The force goes on,
// F = k x. A rising stiffness takes energy, F^2 / (2 k), which goes to `energy_tank` (J); a falling
// one may add what that has and what the apparent mass has at the recovery speed, v^2 / (2 w), but
// no more: there the force falls. Loads at rest stay carried, a load beyond what rows may add does
// not lose force each time that the stiffness falls and rises, and stiffness that changes with the
// configuration cannot pump a mechanism. The spring of what is hit keeps its energy: it must not
// lose what it is about to give back.
double recall_scale(double deformation, double old_stiffness, const Rows& rows, int row,
                    double recovery_speed, bool hit, double& energy_tank) {
  if (deformation == 0.0) return 0.0;
  const double k = rows.stiffness[row];
  if (k == 0.0) return 1.0;  // a dashpot alone: neither force nor energy
  if (old_stiffness == 0.0) return 0.0;
  const double same_force = old_stiffness / k;
  if (std::isinf(recovery_speed)) return same_force;
  const double stored = 0.5 * old_stiffness * deformation * deformation;
  const auto added_by = [&](double scale) { return stored * (scale * scale / same_force - 1.0); };
  if (hit) return std::sqrt(same_force);
  if (same_force <= 1.0) {
    energy_tank -= added_by(same_force);
    return same_force;
  }
  const double w = std::max(rows.inverse_mass[row], rows.typical_inverse_mass[row]);
  const double allowed =
      w > 0.0 ? recovery_speed / (std::sqrt(k * w) * std::abs(deformation)) : same_force;
  const double covered = std::sqrt(same_force * (1.0 + energy_tank / stored));
  const double scale = std::min(same_force, std::max(allowed, covered));
  energy_tank = std::max(0.0, energy_tank - added_by(scale));
  return scale;
}

// Whether what is hit goes on as one hit, which the step does not resolve or the geometry follows:
// its spring, with the remembered `force` (N), throws back what smooth forces alone would not.
bool goes_on_as_hit(double force, const Rows& rows, const RowGroup& c, double length,
                    const RowData& data) {
  const double w = rows.inverse_mass[c.row];
  if (!c.is_of_round_hit && !is_short_hit(rows.stiffness[c.row], w, length)) return false;
  return force * w > kHitLoads * std::abs(first_rate(rows, c, data.smooth_acceleration));
}

// Whether a contact gives back most that it stores: damping ratio to 0.2, restitution over a half.
bool is_elastic(const Rows& rows, const RowGroup& c) {
  const double k = rows.stiffness[c.row], d = rows.damping[c.row];
  return d * d * rows.inverse_mass[c.row] <= 4.0 * kElasticRatio * kElasticRatio * k;
}

// RowData::drift of a contact that turns on as before, a little faster or slower
// (detect/turning.hpp). From one corner to the next, or by a radian in a step, it turns anew.
double drift_of(const RememberedContact& old, const RowGroup& c, double length) {
  const bool in_middle = std::abs(c.ahead - 0.5 * length) <= kMiddle * length;
  const double turning = turn_of_normal(c), change = turning - old.turning;
  const double larger = std::max(std::abs(turning), std::abs(old.turning));
  const bool goes_on = std::abs(change) <= kSteadyTurning * larger;
  return in_middle && goes_on ? 0.125 * length * change : 0.0;
}

// Rigid contacts keep their preload, for their stiffness goes on changing. What is hit keeps all
// that its spring stores, also where the geometry, frozen before, turns out to be less deep.
double recalled_deformation(const RememberedContact& old, const ContactInput& input,
                            const Rows& rows, const RowGroup& c, double recovery_speed,
                            double length, bool hit, double& energy_tank) {
  const double recovered = c.soft_load > 0.0 ? recovery_speed * length : 0.0;
  const double compression =
      hit ? old.compression
          : std::min(old.compression, std::max(old.preload - recovered, 0.0) - input.gap);
  return -compression *
         recall_scale(compression, old.stiffness, rows, c.row, recovery_speed, hit, energy_tank);
}

void recall_friction(const RememberedContact& old, const ContactInput& input, const Rows& rows,
                     const RowGroup& c, double recovery_speed, bool hit, double& energy_tank,
                     RowData& data) {
  double* deformation = data.deformation.data() + c.row;
  const auto scale_of = [&](double remembered, double stiffness, int i) {
    return recall_scale(remembered, stiffness, rows, c.row + i, recovery_speed, hit, energy_tank);
  };
  // Of rows i and i + 1, along the two tangents.
  const auto recall_tangents = [&](const double* vector, double stiffness, int i) {
    const double scale = scale_of(norm(vector), stiffness, more_mobile(rows, c, i));
    for (int k = 0; k < 2; ++k)
      deformation[i + k] = scale * along(vector, input.rotation, input.frame.data() + 3 * (1 + k));
  };
  if (c.dim > 1) recall_tangents(old.slide, old.slide_stiffness, 1);
  if (c.dim > 3) deformation[3] = old.spin * scale_of(old.spin, old.spin_stiffness, 3);
  if (c.dim > 4) recall_tangents(old.roll, old.roll_stiffness, 4);
}

// Position (m or rad) of a limit or equality, no more than what its spring bears or remembers.
double borne_position(const ConstraintInput& input, double remembered, const Rows& rows,
                      const RowGroup& c) {
  const double k = rows.stiffness[c.row];
  const double w = std::max(rows.inverse_mass[c.row], rows.typical_inverse_mass[c.row]);
  if (k * w == 0.0) return 0.0;
  const double most = std::max(kBearableAcceleration * rows.metre / (k * w), std::abs(remembered));
  return std::clamp(input.position, -most, most);
}

// Whether the spring of an equality is one of the model's own solref that steps of `length` (s)
// resolve. What jumps of a mocap body part is no spring's deformation.
bool is_soft_equality(const ConstraintInput& input, const Rows& rows, const RowGroup& c,
                      double length) {
  const double square = rows.stiffness[c.row] * rows.typical_inverse_mass[c.row] * length * length;
  return c.kind == RowKind::kBilateral && input.has_solref && !input.is_of_mocap &&
         square <= kSoftEquality;
}

void recall_constraints(const StepView& step, const Rows& rows, double recovery_speed,
                        RowData& data) {
  double part = 1.0;
  for (size_t index = 0; index < step.constraints.size(); ++index) {
    const RowGroup& c = rows.group[index];
    const ConstraintInput& input = step.constraints[index];
    if (input.memory < 0) continue;
    const RememberedConstraint old = step.memory.constraint(input.memory);
    data.energy_tank[index] = old.energy_tank;
    const auto rescaled = [&](double deformation) {
      return deformation * recall_scale(deformation, old.stiffness, rows, c.row, recovery_speed,
                                        false, data.energy_tank[index]);
    };
    double& deformation = data.deformation[c.row];
    if (c.kind == RowKind::kSlider) {
      deformation = rescaled(old.deformation);
      continue;
    }
    const SpringPlace place = place_of_spring(input, rows, c);
    deformation = place.position;
    if (input.together > 0 && grows_stiffer(step, rows, index))
      part = part_of_places(step, rows, index, data.energy_tank[index]);
    const bool separated = c.kind == RowKind::kUnilateral && input.position >= 0.0;
    if (separated || std::isinf(recovery_speed)) continue;
    // The spring keeps what it remembers, at most what the position says, of the same sign.
    if (c.solref.load > 0.0) {
      deformation *= part;
      data.beyond[index] =
          part * part *
          (place.stored - 0.5 * rows.stiffness[c.row] * place.position * place.position);
    } else if (is_soft_equality(input, rows, c, step.length) ||
               (old.stiffness == 0.0 && begins_stretched(step.memory, input, c)))
      deformation = borne_position(input, old.deformation, rows, c);
    else if (old.stiffness == 0.0)
      deformation = 0.0;
    else if (old.deformation * input.position <= 0.0)
      deformation = 0.0;
    else
      deformation = rescaled(
          std::copysign(std::min(std::abs(old.deformation), std::abs(input.position) + old.preload),
                        input.position));
    data.unstressed[index] = deformation - place.position;
  }
}

// Of a contact that nothing is remembered of: in the first step of all one of SI stiffness or of a
// model's own solref takes what its spring bears.
double first_deformation(const Memory& memory, const ContactInput& input, const Rows& rows,
                         const RowGroup& c, double recovery_speed) {
  if (!memory.starts() || c.soft_load == 0.0) return 0.0;
  return -std::min(-input.gap, bearable_compression(rows, c, recovery_speed));
}

void recall_contacts(const StepView& step, const Rows& rows, double recovery_speed, RowData& data,
                     Team& team) {
  team.for_each(static_cast<int>(rows.group.size()), kContactsAtOnce, [&](int index) {
    const RowGroup& c = rows.group[index];
    if (c.kind != RowKind::kContact) return;
    const ContactInput& input = step.contacts[c.input];
    data.deformation[c.row] = input.gap;
    const int nearest = step.matches[index].nearest;
    // What is hit is frozen where its force is.
    if (nearest >= 0 && data.hit[index] == Hit::kNone)
      data.drift[index] = drift_of(step.memory.contact(nearest), c, step.length);
    if (input.gap >= 0.0 && (nearest < 0 || std::isinf(recovery_speed))) return;
    const RememberedContact old = nearest < 0 ? RememberedContact{} : step.memory.contact(nearest);
    const double force = old.stiffness * old.compression;
    const bool alone = data.is_of_isolated_pair[index];
    const bool hit_now = alone && data.hit[index] != Hit::kNone;
    const bool hit_before = old.was_hit() && (alone || is_elastic(rows, c));
    // In a cluster a neighbour that is hit, too, or a substep that is short, makes it stiffer.
    const bool stiffens = is_elastic(rows, c) && rows.stiffness[c.row] > old.stiffness;
    const bool hit =
        (hit_now || hit_before || stiffens) && goes_on_as_hit(force, rows, c, step.length, data);
    if (input.gap >= 0.0 && !hit) return;
    double& energy_tank = data.energy_tank[index];
    energy_tank = old.energy_tank;
    if (!std::isinf(recovery_speed)) {
      data.deformation[c.row] = nearest < 0
                                    ? first_deformation(step.memory, input, rows, c, recovery_speed)
                                    : recalled_deformation(old, input, rows, c, recovery_speed,
                                                           step.length, hit, energy_tank);
      data.unstressed[index] = data.deformation[c.row] - input.gap;
    }
    if (nearest >= 0) recall_friction(old, input, rows, c, recovery_speed, hit, energy_tank, data);
  });
}

}  // namespace

void recall(const StepView& step, const Rows& rows, double recovery_speed, RowData& data,
            Team& team) {
  recall_constraints(step, rows, recovery_speed, data);
  recall_contacts(step, rows, recovery_speed, data, team);
}

void limit_compression(const StepView& step, const std::vector<std::array<int, 2>>& pairs,
                       const Rows& rows, RowData& data) {
  struct Stored {
    double before = 0.0, now = 0.0;  // twice the energy, J
  };
  std::map<std::array<int, 2>, Stored> stored;
  for (const auto& pair : pairs) stored[pair] = {};
  for (int i = 0; i < step.memory.contact_count(); ++i) {
    const RememberedContact slot = step.memory.contact(i);
    const auto entry = stored.find({int(slot.geom[0]), int(slot.geom[1])});
    if (entry != stored.end())
      entry->second.before += slot.stiffness * slot.compression * slot.compression;
  }
  const auto for_each_compressed = [&](const auto& visit) {
    for (size_t index = 0; index < rows.group.size(); ++index) {
      const RowGroup& c = rows.group[index];
      if (c.kind != RowKind::kContact || data.deformation[c.row] >= 0.0) continue;
      const auto entry = stored.find(step.contacts[c.input].geom);
      if (entry != stored.end()) visit(index, c.row, entry->second);
    }
  };
  for_each_compressed([&](size_t, int row, Stored& pair) {
    pair.now += rows.stiffness[row] * data.deformation[row] * data.deformation[row];
  });
  for_each_compressed([&](size_t index, int row, const Stored& pair) {
    if (pair.now <= pair.before) return;
    const double released = data.deformation[row] * (std::sqrt(pair.before / pair.now) - 1.0);
    data.deformation[row] += released;
    data.unstressed[index] += released;
  });
}

}  // namespace dashpot
