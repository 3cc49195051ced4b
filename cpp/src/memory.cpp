#include "dashpot/memory.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>

namespace dashpot {

namespace {

// Storage: count of contacts, ledger, whether a step was taken, motion that rows hold, lengths of
// steps that lead, velocities at their end, mocap bodies, constraints (deformation, stiffness,
// slack, and the two numbers of equality() of each), contacts.
constexpr int kHeader = 9;
constexpr int kStepped = 8;
constexpr int kConstraint = 5;
constexpr int kEquality = 3;
constexpr int kMocap = sizeof(RememberedMocap) / sizeof(double);
constexpr int kSlot = sizeof(RememberedContact) / sizeof(double);
constexpr int kSlotPosition = offsetof(RememberedContact, position) / sizeof(double);

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

// a t1 + b t2 in the frame of geom 1, t1 and t2 the tangents of the contact.
void tangent_to_local(double a, double b, const ContactInput& input, double* local) {
  for (int i = 0; i < 3; ++i) {
    local[i] = 0.0;
    for (int j = 0; j < 3; ++j)
      local[i] += input.rotation[3 * j + i] * (a * input.frame[3 + j] + b * input.frame[6 + j]);
  }
}

// Factor on what a row remembers of a deformation under another stiffness. The force goes on,
// F = k x, as long as a falling stiffness adds no energy, F^2 / (2 k), beyond what the apparent
// mass has at the recovery speed, v^2 / (2 w); otherwise the energy goes on. Loads at rest stay
// carried, and stiffness that changes with the configuration cannot pump a mechanism.
double recall_scale(double deformation, double old_stiffness, const Rows& rows, int row,
                    double recovery_speed) {
  if (deformation == 0.0) return 0.0;
  const double k = rows.stiffness[row];
  if (k == 0.0) return 1.0;  // a dashpot alone: neither force nor energy
  const double same_force = old_stiffness / k;
  if (same_force <= 1.0 || std::isinf(recovery_speed)) return same_force;
  const double w = std::max(rows.inverse_mass[row], rows.typical_inverse_mass[row]);
  const double allowed =
      w > 0.0 ? recovery_speed / (std::sqrt(k * w) * std::abs(deformation)) : same_force;
  return std::max(std::sqrt(same_force), std::min(same_force, allowed));
}

// By how much a spring is deformed beyond its position, deformation - offset, of the same sign.
double slack(double deformation, double offset) {
  const bool beyond = deformation * offset > 0.0 && std::abs(offset) <= std::abs(deformation);
  return beyond ? std::abs(offset) : 0.0;
}

double norm(const double* v) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

// A geom pair as one number.
std::uint64_t pair_key(int geom1, int geom2) {
  return static_cast<std::uint64_t>(static_cast<std::uint32_t>(geom1)) << 32 |
         static_cast<std::uint32_t>(geom2);
}

// Finds the slots of a geom pair, in their order: chains by the hash of the pair.
class SlotsByPair {
 public:
  // Appends a chain's slots in front, so they are to be added from the last one down.
  void reset(int slots) {
    bits_ = 1;
    while ((1 << bits_) < 2 * slots) ++bits_;
    first_.assign(size_t{1} << bits_, -1);
    next_.resize(slots);
    key_.resize(slots);
  }
  void add(std::uint64_t pair, int slot) {
    int& first = first_[bucket(pair)];
    key_[slot] = pair;
    next_[slot] = first;
    first = slot;
  }
  template <typename Visit>
  void for_each(std::uint64_t pair, const Visit& visit) const {
    for (int slot = first_[bucket(pair)]; slot >= 0; slot = next_[slot])
      if (key_[slot] == pair) visit(slot);
  }

 private:
  // Fibonacci hashing: multiplication by 2^64 over the golden ratio.
  size_t bucket(std::uint64_t pair) const { return pair * 0x9E3779B97F4A7C15u >> (64 - bits_); }

  int bits_ = 1;
  std::vector<int> first_, next_;
  std::vector<std::uint64_t> key_;
};

}  // namespace

int MemoryLayout::held_size() const { return 3 * held_trees + held_dofs + 2 * held_coordinates; }

int MemoryLayout::leading_size() const { return held_trees + held_dofs; }

int MemoryLayout::mocap_size() const { return kMocap * mocap_bodies; }

int MemoryLayout::size() const {
  return kHeader + held_size() + leading_size() + mocap_size() + kConstraint * constraints +
         kSlot * contacts;
}

double* Memory::mocap_storage() const {
  return storage_ + kHeader + layout_.held_size() + layout_.leading_size();
}

double* Memory::constraint_storage() const { return mocap_storage() + layout_.mocap_size(); }

double* Memory::contact_storage(int index) const {
  return constraint_storage() + kConstraint * layout_.constraints + kSlot * index;
}

HeldMotion Memory::held_motion() const {
  if (layout_.held_trees == 0) return {};
  HeldMotion motion;
  motion.length = storage_ + kHeader;
  motion.weight = motion.length + layout_.held_trees;
  motion.energy = motion.weight + layout_.held_trees;
  motion.displacement = motion.energy + layout_.held_trees;
  motion.acceleration = motion.displacement + layout_.held_dofs;
  motion.other_force = motion.acceleration + layout_.held_coordinates;
  return motion;
}

double* Memory::leading_length() const {
  return layout_.held_trees == 0 ? nullptr : storage_ + kHeader + layout_.held_size();
}

double* Memory::end_velocity() const {
  return layout_.held_trees == 0 ? nullptr : leading_length() + layout_.held_trees;
}

RememberedMocap Memory::mocap(int index) const {
  RememberedMocap mocap;
  std::memcpy(&mocap, mocap_storage() + kMocap * index, sizeof(mocap));
  return mocap;
}

void Memory::set_mocap(int index, const RememberedMocap& mocap) {
  std::memcpy(mocap_storage() + kMocap * index, &mocap, sizeof(mocap));
}

double* Memory::equality(int constraint) const {
  return constraint_storage() + kConstraint * constraint + kEquality;
}

void Memory::check() const {
  if (storage_[0] >= 0.0 && storage_[0] <= layout_.contacts &&
      storage_[0] == std::floor(storage_[0]))
    return;
  throw std::invalid_argument("data.userdata holds no contact memory: its number of contacts is " +
                              std::to_string(storage_[0]) + "; it must be an integer in [0, " +
                              std::to_string(layout_.contacts) + "]");
}

int Memory::contact_count() const { return static_cast<int>(storage_[0]); }

RememberedContact Memory::contact(int index) const {
  RememberedContact slot;
  std::memcpy(&slot, contact_storage(index), sizeof(slot));
  return slot;
}

EnergyLedger Memory::ledger() const {
  return {storage_[1], storage_[2], storage_[3], storage_[4],
          storage_[5], storage_[6], storage_[7]};
}

void Memory::set_ledger(const EnergyLedger& ledger) {
  storage_[1] = ledger.elastic;
  storage_[2] = ledger.dissipated_normal;
  storage_[3] = ledger.dissipated_friction;
  storage_[4] = ledger.dissipated_constraint;
  storage_[5] = ledger.dissipated_recovery;
  storage_[6] = ledger.dissipated_damping;
  storage_[7] = ledger.work;
}

void Memory::recall(const std::vector<ContactInput>& contacts,
                    const std::vector<ConstraintInput>& constraints, const Rows& rows,
                    double recovery_speed, double length, RowData& data) const {
  recall_constraints(constraints, rows, recovery_speed, data);
  recall_contacts(contacts, rows, recovery_speed, length, data);
}

void Memory::recall_constraints(const std::vector<ConstraintInput>& constraints, const Rows& rows,
                                double recovery_speed, RowData& data) const {
  for (size_t index = 0; index < rows.group.size(); ++index) {
    const RowGroup& c = rows.group[index];
    if (c.kind == RowKind::kContact) continue;
    const ConstraintInput& input = constraints[c.input];
    const double* slot = constraint_storage() + kConstraint * input.memory;
    const auto rescaled = [&](double deformation) {
      return deformation * recall_scale(deformation, slot[1], rows, c.row, recovery_speed);
    };
    double& deformation = data.deformation[c.row];
    if (c.kind == RowKind::kSlider) {
      deformation = rescaled(slot[0]);
      continue;
    }
    deformation = input.position;
    const bool separated = c.kind == RowKind::kUnilateral && input.position >= 0.0;
    if (separated || std::isinf(recovery_speed)) continue;
    // The spring keeps what it remembers, at most what the position says, of the same sign.
    deformation =
        slot[0] * input.position <= 0.0
            ? 0.0
            : rescaled(std::copysign(
                  std::min(std::abs(slot[0]), std::abs(input.position) + slot[2]), input.position));
    data.offset[index] = deformation - input.position;
  }
}

void Memory::recall_contacts(const std::vector<ContactInput>& contacts, const Rows& rows,
                             double recovery_speed, double length, RowData& data) const {
  const bool starts = storage_[kStepped] == 0.0;
  thread_local SlotsByPair slots;  // kept by the thread: no allocation in a step
  slots.reset(contact_count());
  for (int i = contact_count() - 1; i >= 0; --i) {
    const double* slot = contact_storage(i);
    slots.add(pair_key(static_cast<int>(slot[0]), static_cast<int>(slot[1])), i);
  }
  for (size_t index = 0; index < rows.group.size(); ++index) {
    const RowGroup& c = rows.group[index];
    if (c.kind != RowKind::kContact) continue;
    const ContactInput& input = contacts[c.input];
    data.deformation[c.row] = input.gap;
    if (input.gap >= 0.0) continue;
    // Nearest old point of the pair; a point fixed to either geom is recognised by that geom.
    int nearest_slot = -1;
    double nearest_distance = std::numeric_limits<double>::infinity();
    slots.for_each(pair_key(input.geom[0], input.geom[1]), [&](int index_of_slot) {
      const double* position = contact_storage(index_of_slot) + kSlotPosition;
      const double distance =
          std::min(squared_distance(position, input.local_position[0].data()),
                   squared_distance(position + 3, input.local_position[1].data()));
      if (distance < nearest_distance) {
        nearest_distance = distance;
        nearest_slot = index_of_slot;
      }
    });
    RememberedContact slot;
    const RememberedContact* nearest = nullptr;
    if (nearest_slot >= 0) {
      slot = contact(nearest_slot);
      nearest = &slot;
    }
    const auto scale_of = [&](double deformation, double stiffness, int i) {
      return recall_scale(deformation, stiffness, rows, c.row + i, recovery_speed);
    };
    if (!std::isinf(recovery_speed)) {
      // Rigid contacts keep their slack, for their stiffness goes on changing.
      const double recovered = c.soft_load > 0.0 ? recovery_speed * length : 0.0;
      const double compression =
          nearest ? std::min(nearest->compression,
                             std::max(nearest->slack - recovered, 0.0) - input.gap)
                  : 0.0;
      const double at_first =
          starts && c.soft_load > 0.0
              ? std::min(-input.gap, bearable_compression(rows, c, recovery_speed))
              : 0.0;
      data.deformation[c.row] =
          nearest ? -compression * scale_of(compression, nearest->stiffness, 0) : -at_first;
      data.offset[index] = data.deformation[c.row] - input.gap;
    }
    if (!nearest) continue;
    if (c.dim > 1) {
      const double scale = scale_of(norm(nearest->slide), nearest->slide_stiffness, 1);
      for (int i = 0; i < 2; ++i)
        data.deformation[c.row + 1 + i] =
            scale * along(nearest->slide, input.rotation, input.frame.data() + 3 * (1 + i));
    }
    if (c.dim > 3)
      data.deformation[c.row + 3] =
          nearest->spin * scale_of(nearest->spin, nearest->spin_stiffness, 3);
    if (c.dim > 4) {
      const double scale = scale_of(norm(nearest->roll), nearest->roll_stiffness, 4);
      for (int i = 0; i < 2; ++i)
        data.deformation[c.row + 4 + i] =
            scale * along(nearest->roll, input.rotation, input.frame.data() + 3 * (1 + i));
    }
  }
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

void Memory::remember(const std::vector<ContactInput>& contacts,
                      const std::vector<ConstraintInput>& constraints, const Rows& rows,
                      const RowData& data) {
  std::fill(constraint_storage(), contact_storage(0), 0.0);
  int count = 0;
  for (size_t index = 0; index < rows.group.size(); ++index) {
    const RowGroup& c = rows.group[index];
    if (c.kind != RowKind::kContact) {
      double* slot = constraint_storage() + kConstraint * constraints[c.input].memory;
      const bool separated = c.kind == RowKind::kUnilateral && data.deformation[c.row] >= 0.0;
      slot[0] = separated ? 0.0 : data.deformation[c.row];
      slot[1] = rows.stiffness[c.row];
      if (c.kind != RowKind::kSlider) slot[2] = slack(slot[0], data.offset[index]);
      continue;
    }
    if (data.deformation[c.row] >= 0.0) continue;
    const ContactInput& input = contacts[c.input];
    const double* s = data.deformation.data() + c.row;
    const double* k = rows.stiffness.data() + c.row;
    RememberedContact slot{};
    for (int side = 0; side < 2; ++side) {
      slot.geom[side] = input.geom[side];
      std::copy_n(input.local_position[side].begin(), 3, slot.position[side]);
    }
    slot.source = input.source;
    slot.sticking = data.sticking[index];
    slot.compression = -s[0];
    slot.stiffness = k[0];
    slot.slack = slack(s[0], data.offset[index]);
    if (c.dim > 1) {
      tangent_to_local(s[1], s[2], input, slot.slide);
      slot.slide_stiffness = k[1];
    }
    if (c.dim > 3) {
      slot.spin = s[3];
      slot.spin_stiffness = k[3];
    }
    if (c.dim > 4) {
      tangent_to_local(s[4], s[5], input, slot.roll);
      slot.roll_stiffness = k[4];
    }
    std::memcpy(contact_storage(count++), &slot, sizeof(slot));
  }
  if (count < contact_count())
    std::fill(contact_storage(count), contact_storage(contact_count()), 0.0);
  storage_[0] = count;
  storage_[kStepped] = 1.0;
}

}  // namespace dashpot
