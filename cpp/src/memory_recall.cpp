// What rows take from memory at the start of a step.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>

#include "dashpot/memory.hpp"
#include "dashpot/slots_by_pair.hpp"

namespace dashpot {

namespace {

constexpr int kSlotPosition = offsetof(RememberedContact, position) / sizeof(double);
constexpr int kSlotCompression = offsetof(RememberedContact, compression) / sizeof(double);
constexpr int kSlotStiffness = offsetof(RememberedContact, stiffness) / sizeof(double);

// That of a hundred weights, as contacts of SI stiffness bear: m/s^2 or rad/s^2.
constexpr double kBearableAcceleration = 100.0 * 9.80665;
constexpr int kContactsAtOnce = 64;  // by a thread

double squared_distance(const double* a, const double* b) {
  double sum = 0.0;
  for (int i = 0; i < 3; ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return sum;
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
// F = k x. A rising stiffness takes energy, F^2 / (2 k), which goes to `credit` (J); a falling one
// may add what that has and what the apparent mass has at the recovery speed, v^2 / (2 w), but no
// more: there the force falls. Loads at rest stay carried, a load beyond what rows may add does not
// lose force each time that the stiffness falls and rises, and stiffness that changes with the
// configuration cannot pump a mechanism.
double recall_scale(double deformation, double old_stiffness, const Rows& rows, int row,
                    double recovery_speed, double& credit) {
  if (deformation == 0.0) return 0.0;
  const double k = rows.stiffness[row];
  if (k == 0.0) return 1.0;  // a dashpot alone: neither force nor energy
  const double same_force = old_stiffness / k;
  if (std::isinf(recovery_speed)) return same_force;
  const double stored = 0.5 * old_stiffness * deformation * deformation;
  const auto added_by = [&](double scale) { return stored * (scale * scale / same_force - 1.0); };
  if (same_force <= 1.0) {
    credit -= added_by(same_force);
    return same_force;
  }
  const double w = std::max(rows.inverse_mass[row], rows.typical_inverse_mass[row]);
  const double allowed =
      w > 0.0 ? recovery_speed / (std::sqrt(k * w) * std::abs(deformation)) : same_force;
  const double covered = std::sqrt(same_force * (1.0 + credit / stored));
  const double scale = std::min(same_force, std::max(allowed, covered));
  credit = std::max(0.0, credit - added_by(scale));
  return scale;
}

// Rigid contacts keep their slack, for their stiffness goes on changing.
double recalled_deformation(const RememberedContact& old, const ContactInput& input,
                            const Rows& rows, const RowGroup& c, double recovery_speed,
                            double length, double& credit) {
  const double recovered = c.soft_load > 0.0 ? recovery_speed * length : 0.0;
  const double compression =
      std::min(old.compression, std::max(old.slack - recovered, 0.0) - input.gap);
  return -compression *
         recall_scale(compression, old.stiffness, rows, c.row, recovery_speed, credit);
}

void recall_friction(const RememberedContact& old, const ContactInput& input, const Rows& rows,
                     const RowGroup& c, double recovery_speed, double& credit, RowData& data) {
  double* deformation = data.deformation.data() + c.row;
  const auto scale_of = [&](double remembered, double stiffness, int i) {
    return recall_scale(remembered, stiffness, rows, c.row + i, recovery_speed, credit);
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

}  // namespace

void Memory::recall(const std::vector<ContactInput>& contacts,
                    const std::vector<ConstraintInput>& constraints,
                    const std::vector<Match>& matches, const Rows& rows, double recovery_speed,
                    double length, RowData& data, Team& team) const {
  recall_constraints(constraints, rows, recovery_speed, data);
  recall_contacts(contacts, matches, rows, recovery_speed, length, data, team);
}

// Of a limit or equality that nothing is remembered of and whose solref the model sets: an
// equality, which users switch on, takes what its spring bears in any step, a limit in the first of
// all.
double Memory::first_deformation(const ConstraintInput& input, const Rows& rows,
                                 const RowGroup& c) const {
  const double k = rows.stiffness[c.row];
  const double w = std::max(rows.inverse_mass[c.row], rows.typical_inverse_mass[c.row]);
  const bool acts = c.kind == RowKind::kBilateral || starts();
  if (!input.has_solref || !acts || k * w == 0.0) return 0.0;
  const double bearable = kBearableAcceleration / (k * w);
  return std::clamp(input.position, -bearable, bearable);
}

void Memory::recall_constraints(const std::vector<ConstraintInput>& constraints, const Rows& rows,
                                double recovery_speed, RowData& data) const {
  for (size_t index = 0; index < rows.group.size(); ++index) {
    const RowGroup& c = rows.group[index];
    if (c.kind == RowKind::kContact) continue;
    const ConstraintInput& input = constraints[c.input];
    const RememberedConstraint old = constraint(input.memory);
    data.credit[index] = old.credit;
    const auto rescaled = [&](double deformation) {
      return deformation * recall_scale(deformation, old.stiffness, rows, c.row, recovery_speed,
                                        data.credit[index]);
    };
    double& deformation = data.deformation[c.row];
    if (c.kind == RowKind::kSlider) {
      deformation = rescaled(old.deformation);
      continue;
    }
    deformation = input.position;
    const bool separated = c.kind == RowKind::kUnilateral && input.position >= 0.0;
    if (separated || std::isinf(recovery_speed)) continue;
    // The spring keeps what it remembers, at most what the position says, of the same sign.
    if (old.stiffness == 0.0)
      deformation = first_deformation(input, rows, c);
    else if (old.deformation * input.position <= 0.0)
      deformation = 0.0;
    else
      deformation = rescaled(
          std::copysign(std::min(std::abs(old.deformation), std::abs(input.position) + old.slack),
                        input.position));
    data.offset[index] = deformation - input.position;
  }
}

// The nearest remembered point of the pair, -1 if there is none; a point fixed to either geom is
// recognised by that geom.
std::pair<int, double> Memory::nearest_contact(const ContactInput& input,
                                               const SlotsByPair& slots) const {
  int nearest = -1;
  double least = std::numeric_limits<double>::infinity();
  slots.for_each(pair_key(input.geom[0], input.geom[1]), [&](int index) {
    const double* position = contact_storage(index) + kSlotPosition;
    const double distance =
        std::min(squared_distance(position, input.local_position[0].data()),
                 squared_distance(position + 3, input.local_position[1].data()));
    if (distance >= least) return;
    least = distance;
    nearest = index;
  });
  return {nearest, least};
}

// Of a contact that nothing is remembered of: in the first step of all one of SI stiffness or of a
// model's own solref takes what its spring bears.
double Memory::first_deformation(const ContactInput& input, const Rows& rows, const RowGroup& c,
                                 double recovery_speed) const {
  if (!starts() || c.soft_load == 0.0) return 0.0;
  return -std::min(-input.gap, bearable_compression(rows, c, recovery_speed));
}

namespace {

using NearestSlot = std::pair<int, double>;

struct MatchBuffers {
  SlotsByPair slots;
  std::vector<NearestSlot> found;  // by group
  std::vector<int> heir;           // by slot
  std::vector<double> distance;    // by slot
};

}  // namespace

void Memory::match(const std::vector<ContactInput>& contacts, const Rows& rows,
                   std::vector<Match>& matches, Team& team) const {
  matches.assign(rows.group.size(), Match());
  thread_local MatchBuffers kept;  // by the thread: no allocation in a step
  auto& [slots, found, heir, distance] = kept;
  slots.reset(contact_count());
  for (int i = contact_count() - 1; i >= 0; --i) {
    const double* slot = contact_storage(i);
    slots.add(pair_key(static_cast<int>(slot[0]), static_cast<int>(slot[1])), i);
  }
  const auto force = [&](int slot) {
    const double* values = contact_storage(slot);
    return values[kSlotCompression] * values[kSlotStiffness];
  };
  // By remembered point: the group that is nearest to it. Another one near it is a new point: a
  // compression that two inherit would be two springs as deep.
  heir.assign(contact_count(), -1);
  distance.assign(contact_count(), std::numeric_limits<double>::infinity());
  found.resize(rows.group.size());
  // Threads are to see what this one keeps, not what they keep themselves.
  const SlotsByPair& all_slots = slots;
  std::vector<NearestSlot>& nearest_slot = found;
  team.for_each(static_cast<int>(rows.group.size()), kContactsAtOnce, [&](int index) {
    const RowGroup& c = rows.group[index];
    if (c.kind != RowKind::kContact) return;
    const ContactInput& input = contacts[c.input];
    all_slots.for_each(pair_key(input.geom[0], input.geom[1]),
                       [&](int slot) { matches[index].load += force(slot); });
    if (input.gap < 0.0) nearest_slot[index] = nearest_contact(input, all_slots);
  });
  bool any_at_seam = false;
  for (size_t index = 0; index < rows.group.size(); ++index) {
    const RowGroup& c = rows.group[index];
    if (c.kind != RowKind::kContact) continue;
    const ContactInput& input = contacts[c.input];
    any_at_seam = any_at_seam || input.is_at_seam();
    if (input.gap >= 0.0) continue;
    const auto [nearest, away] = found[index];
    if (nearest < 0 || !(away < distance[nearest])) continue;
    if (heir[nearest] >= 0) matches[heir[nearest]].nearest = -1;
    heir[nearest] = static_cast<int>(index);
    distance[nearest] = away;
    matches[index].nearest = nearest;
  }
  if (any_at_seam) match_at_seams(contacts, rows, slots, heir, matches);
}

// What a geom rolls on to remembers what it left, by the place on that geom, geom 1 of both.
void Memory::match_at_seams(const std::vector<ContactInput>& contacts, const Rows& rows,
                            const SlotsByPair& slots, std::vector<int>& heir,
                            std::vector<Match>& matches) const {
  for (size_t index = 0; index < rows.group.size(); ++index) {
    const RowGroup& c = rows.group[index];
    if (c.kind != RowKind::kContact || matches[index].nearest >= 0) continue;
    const ContactInput& input = contacts[c.input];
    if (!input.is_at_seam() || input.gap >= 0.0) continue;
    int& nearest = matches[index].nearest;
    double least = std::numeric_limits<double>::infinity();
    const auto visit = [&](int slot) {
      const double* values = contact_storage(slot);
      matches[index].load += values[kSlotCompression] * values[kSlotStiffness];
      const double away = squared_distance(values + kSlotPosition, input.local_position[0].data());
      if (heir[slot] >= 0 || away >= least) return;
      least = away;
      nearest = slot;
    };
    for (int other : input.takes_over)
      if (other >= 0) slots.for_each(pair_key(input.geom[0], other), visit);
    if (nearest >= 0) heir[nearest] = static_cast<int>(index);
  }
}

void Memory::recall_contacts(const std::vector<ContactInput>& contacts,
                             const std::vector<Match>& matches, const Rows& rows,
                             double recovery_speed, double length, RowData& data,
                             Team& team) const {
  team.for_each(static_cast<int>(rows.group.size()), kContactsAtOnce, [&](int index) {
    const RowGroup& c = rows.group[index];
    if (c.kind != RowKind::kContact) return;
    const ContactInput& input = contacts[c.input];
    data.deformation[c.row] = input.gap;
    if (input.gap >= 0.0) return;
    const int nearest = matches[index].nearest;
    const RememberedContact old = nearest < 0 ? RememberedContact{} : contact(nearest);
    double& credit = data.credit[index];
    credit = old.credit;
    if (!std::isinf(recovery_speed)) {
      data.deformation[c.row] =
          nearest < 0 ? first_deformation(input, rows, c, recovery_speed)
                      : recalled_deformation(old, input, rows, c, recovery_speed, length, credit);
      data.offset[index] = data.deformation[c.row] - input.gap;
    }
    if (nearest >= 0) recall_friction(old, input, rows, c, recovery_speed, credit, data);
  });
}

void Memory::limit_compression(const std::vector<std::array<int, 2>>& pairs,
                               const std::vector<ContactInput>& contacts, const Rows& rows,
                               RowData& data) const {
  struct Stored {
    double before = 0.0, now = 0.0;  // twice the energy, J
  };
  std::map<std::array<int, 2>, Stored> stored;
  for (const auto& pair : pairs) stored[pair] = {};
  for (int i = 0; i < contact_count(); ++i) {
    const RememberedContact slot = contact(i);
    const auto entry = stored.find({int(slot.geom[0]), int(slot.geom[1])});
    if (entry != stored.end())
      entry->second.before += slot.stiffness * slot.compression * slot.compression;
  }
  const auto for_each_compressed = [&](const auto& visit) {
    for (size_t index = 0; index < rows.group.size(); ++index) {
      const RowGroup& c = rows.group[index];
      if (c.kind != RowKind::kContact || data.deformation[c.row] >= 0.0) continue;
      const auto entry = stored.find(contacts[c.input].geom);
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
    data.offset[index] += released;
  });
}

}  // namespace dashpot
