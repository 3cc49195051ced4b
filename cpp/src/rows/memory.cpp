#include "dashpot/rows/memory.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <stdexcept>
#include <string>

namespace dashpot {

namespace {

// Storage: count of contacts, ledger, whether a step was taken, positions at its end, motion that
// trees follow, velocities at its end, mocap bodies, constraints, contacts.
constexpr int kHeader = 9;
constexpr int kStepped = 8;
constexpr int kMocap = sizeof(RememberedMocap) / sizeof(double);
constexpr int kContactsAtOnce = 64;  // by a thread

// a t1 + b t2 in the frame of geom 1, t1 and t2 the tangents of the contact.
void tangent_to_local(double a, double b, const ContactInput& input, double* local) {
  for (int i = 0; i < 3; ++i) {
    local[i] = 0.0;
    for (int j = 0; j < 3; ++j)
      local[i] += input.rotation[3 * j + i] * (a * input.frame[3 + j] + b * input.frame[6 + j]);
  }
}

bool is_integer(double value, int least, int most) {
  return value >= least && value <= most && value == std::floor(value);
}

[[noreturn]] void refuse(const std::string& what, double value, int least, int most) {
  throw std::invalid_argument("data.userdata holds no contact memory: " + what + " is " +
                              std::to_string(value) + "; it must be an integer in [" +
                              std::to_string(least) + ", " + std::to_string(most) + "]");
}

// By how much a spring is deformed beyond its position, deformation - offset, of the same sign.
double preload(double deformation, double offset) {
  const bool beyond = deformation * offset > 0.0 && std::abs(offset) <= std::abs(deformation);
  return beyond ? std::abs(offset) : 0.0;
}

}  // namespace

int MemoryLayout::held_size() const {
  return 5 * held_trees + 6 * held_dofs + 2 * held_coordinates;
}

int MemoryLayout::mocap_size() const { return kMocap * driven_bodies; }

int MemoryLayout::size() const {
  return kHeader + positions + held_size() + mocap_size() +
         static_cast<int>(sizeof(RememberedConstraint) / sizeof(double)) * constraints +
         static_cast<int>(sizeof(RememberedContact) / sizeof(double)) * contacts;
}

Memory::Memory(double* storage, const MemoryLayout& layout)
    : storage_(storage),
      layout_(layout),
      contacts_(constraint_storage() + kConstraintSize * layout.constraints) {}

double* Memory::position() const { return storage_ + kHeader; }

double* Memory::mocap_storage() const {
  return position() + layout_.positions + layout_.held_size();
}

double* Memory::constraint_storage() const { return mocap_storage() + layout_.mocap_size(); }

HeldMotion Memory::held_motion() const {
  if (layout_.held_trees == 0) return {};
  HeldMotion motion;
  motion.length = position() + layout_.positions;
  motion.held = motion.length + layout_.held_trees;
  motion.implicit_time = motion.held + layout_.held_trees;
  motion.gravity_ahead = motion.implicit_time + layout_.held_trees;
  motion.energy = motion.gravity_ahead + layout_.held_trees;
  motion.displacement = motion.energy + layout_.held_trees;
  motion.potential = motion.displacement + layout_.held_dofs;
  motion.drive = motion.potential + layout_.held_dofs;
  motion.commanded_change = motion.drive + layout_.held_dofs;
  motion.followed = motion.commanded_change + layout_.held_dofs;
  motion.acceleration = motion.followed + layout_.held_dofs;
  motion.other_force = motion.acceleration + layout_.held_coordinates;
  return motion;
}

double* Memory::end_velocity() const {
  return layout_.held_trees == 0 ? nullptr : held_motion().other_force + layout_.held_coordinates;
}

RememberedMocap Memory::mocap(int index) const {
  RememberedMocap mocap;
  std::memcpy(&mocap, mocap_storage() + kMocap * index, sizeof(mocap));
  return mocap;
}

void Memory::set_mocap(int index, const RememberedMocap& mocap) {
  std::memcpy(mocap_storage() + kMocap * index, &mocap, sizeof(mocap));
}

RememberedConstraint Memory::constraint(int index) const {
  RememberedConstraint slot;
  std::memcpy(&slot, constraint_storage() + kConstraintSize * index, sizeof(slot));
  return slot;
}

double* Memory::equality(int constraint) const {
  return constraint_storage() + kConstraintSize * constraint +
         offsetof(RememberedConstraint, mean_force) / sizeof(double);
}

bool Memory::starts() const { return storage_[kStepped] == 0.0; }

bool Memory::has_rows() const {
  bool any = contact_count() > 0;
  for (int i = 0; i < layout_.constraints && !any; ++i) any = constraint(i).stiffness != 0.0;
  return any;
}

void Memory::check() const {
  if (!is_integer(storage_[0], 0, layout_.contacts))
    refuse("its number of contacts", storage_[0], 0, layout_.contacts);
  if (!std::all_of(storage_ + 1, storage_ + kStepped, [](double x) { return std::isfinite(x); }))
    throw std::invalid_argument(
        "data.userdata holds no contact memory: its energies must be finite");
  for (int i = 0; i < contact_count(); ++i)
    for (int side = 0; side < 2; ++side)
      if (const double geom = contact_storage(i)[side];
          !is_integer(geom, -layout_.flexes, layout_.geoms - 1))
        refuse("geom " + std::to_string(side + 1) + " of its contact " + std::to_string(i), geom,
               -layout_.flexes, layout_.geoms - 1);
}

int Memory::contact_count() const { return static_cast<int>(storage_[0]); }

RememberedContact Memory::contact(int index) const {
  RememberedContact slot;
  std::memcpy(static_cast<void*>(&slot), contact_storage(index), sizeof(slot));
  return slot;
}

std::array<int, 2> Memory::geoms(int index) const {
  const double* geom = contact_storage(index) + offsetof(RememberedContact, geom) / sizeof(double);
  return {static_cast<int>(geom[0]), static_cast<int>(geom[1])};
}

const double* Memory::position(int index, int side) const {
  return contact_storage(index) + offsetof(RememberedContact, position) / sizeof(double) + 3 * side;
}

double Memory::force(int index) const {
  const double* slot = contact_storage(index);
  return slot[offsetof(RememberedContact, compression) / sizeof(double)] *
         slot[offsetof(RememberedContact, stiffness) / sizeof(double)];
}

double Memory::parted_hit(int index) const {
  const double* slot = contact_storage(index);
  const double hit = slot[offsetof(RememberedContact, hit) / sizeof(double)];
  return hit != static_cast<double>(Hit::kNone)
             ? slot[offsetof(RememberedContact, compression) / sizeof(double)]
             : 0.0;
}

EnergyLedger Memory::ledger() const {
  static_assert(sizeof(EnergyLedger) == (kStepped - 1) * sizeof(double));
  EnergyLedger ledger;
  std::memcpy(&ledger, storage_ + 1, sizeof(ledger));
  return ledger;
}

void Memory::set_ledger(const EnergyLedger& ledger) {
  std::memcpy(storage_ + 1, &ledger, sizeof(ledger));
}

void Memory::remember(const std::vector<ContactInput>& contacts,
                      const std::vector<ConstraintInput>& constraints, const Rows& rows,
                      const RowData& data, const std::vector<int>& compressed,
                      const MarkedRows& sleeping, Team& team) {
  forget_constraints(sleeping);
  const int asleep = gather(sleeping);
  for (size_t i = 0; i < constraints.size(); ++i)
    remember(constraints[i], rows, static_cast<int>(i), data);
  int count = static_cast<int>(compressed.size());
  team.for_each(count, kContactsAtOnce, [=, &contacts, &rows, &data, &compressed](int slot) {
    remember(contacts[rows.group[compressed[slot]].input], rows, compressed[slot], data,
             asleep + slot);
  });
  count += asleep;
  if (count < contact_count())
    std::fill(contact_storage(count), contact_storage(contact_count()), 0.0);
  storage_[0] = count;
  storage_[kStepped] = 1.0;
}

void Memory::remember(const ConstraintInput& input, const Rows& rows, int index,
                      const RowData& data) {
  if (input.memory < 0) return;
  const RowGroup& c = rows.group[index];
  RememberedConstraint slot{};
  const bool separated = c.kind == RowKind::kUnilateral && data.deformation[c.row] >= 0.0;
  slot.stiffness = rows.stiffness[c.row];
  if (!separated) {
    slot.deformation = data.deformation[c.row];
    slot.energy_tank = data.energy_tank[index];
    slot.beyond = data.beyond[index];
  }
  if (c.kind != RowKind::kSlider) slot.preload = preload(slot.deformation, data.unstressed[index]);
  std::memcpy(constraint_storage() + kConstraintSize * input.memory, &slot, sizeof(slot));
}

void Memory::remember(const ContactInput& input, const Rows& rows, int index, const RowData& data,
                      int place) {
  const RowGroup& c = rows.group[index];
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
  slot.preload = preload(s[0], data.unstressed[index]);
  if (c.dim > 1) {
    tangent_to_local(s[1], s[2], input, slot.slide);
    slot.slide_stiffness = k[more_mobile(rows, c, 1)];
  }
  if (c.dim > 3) {
    slot.spin = s[3];
    slot.spin_stiffness = k[3];
  }
  if (c.dim > 4) {
    tangent_to_local(s[4], s[5], input, slot.roll);
    slot.roll_stiffness = k[more_mobile(rows, c, 4)];
  }
  slot.energy_tank = data.energy_tank[index];
  const double change = data.total_impulse[c.row] * rows.inverse_mass[c.row];  // m/s
  const bool comes = input.gap > 0.0 && change > kHitSpeed * rows.metre;
  const Hit hit = !data.is_of_isolated_pair[index] ? Hit::kNone
                  : comes                          ? Hit::kNow
                                                   : data.hit[index];
  slot.hit = static_cast<double>(hit);
  slot.turning = turn_of_normal(c);
  slot.solref = c.solref;
  std::memcpy(contact_storage(place), &slot, sizeof(slot));
}

}  // namespace dashpot
