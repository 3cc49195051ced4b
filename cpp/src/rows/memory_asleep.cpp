// What memory keeps of what sleeps, whose rows are not made.

#include <algorithm>
#include <cstddef>

#include "dashpot/rows/memory.hpp"

namespace dashpot {

bool SleepingRows::has(const std::array<int, 2>& geoms) const {
  bool any = false;
  for (int index : geoms) {
    if (index < 0 || geom[index] == GeomSleep::kIsAwake) return false;
    any = any || geom[index] == GeomSleep::kSleeps;
  }
  return any;
}

void Memory::rest(const Tree& tree, int index) {
  if (layout_.held_trees == 0) return;
  held_motion().length[index] = lead()[index] = 0.0;
  std::fill_n(end_velocity() + tree.dof_begin, tree.dof_count, 0.0);
}

int Memory::count(const SleepingRows& sleeping) const {
  int count = 0;
  for (int i = 0; i < contact_count() && !sleeping.geom.empty(); ++i)
    count += sleeping.has(geoms(i));
  return count;
}

double Memory::energy(const SleepingRows& sleeping) const {
  const auto spring = [](double stiffness, double deformation) {
    return 0.5 * stiffness * deformation * deformation;
  };
  double sum = 0.0;
  for (int i = 0; i < contact_count() && !sleeping.geom.empty(); ++i) {
    if (!sleeping.has(geoms(i))) continue;
    const RememberedContact slot = contact(i);
    sum += spring(slot.stiffness, slot.compression) + spring(slot.spin_stiffness, slot.spin);
    for (int axis = 0; axis < 3; ++axis)
      sum += spring(slot.slide_stiffness, slot.slide[axis]) +
             spring(slot.roll_stiffness, slot.roll[axis]);
  }
  for (size_t i = 0; i < sleeping.constraint.size(); ++i)
    if (sleeping.constraint[i]) {
      const RememberedConstraint slot = constraint(static_cast<int>(i));
      sum += spring(slot.stiffness, slot.deformation) + slot.beyond;
    }
  return sum;
}

void Memory::forget_constraints(const SleepingRows& sleeping) {
  if (sleeping.constraint.empty()) {
    std::fill(constraint_storage(), contact_storage(0), 0.0);
    return;
  }
  for (int i = 0; i < layout_.constraints; ++i)
    if (!sleeping.constraint[i])
      std::fill_n(constraint_storage() + kConstraintSize * i, kConstraintSize, 0.0);
}

// Gathers the contacts that sleep before all others; returns how many.
int Memory::gather(const SleepingRows& sleeping) {
  int count = 0;
  for (int i = 0; i < contact_count() && !sleeping.geom.empty(); ++i) {
    if (!sleeping.has(geoms(i))) continue;
    double* const place = contact_storage(count++);
    if (place != contact_storage(i)) std::copy_n(contact_storage(i), kContactSize, place);
    place[offsetof(RememberedContact, source) / sizeof(double)] = -1.0;  // no step detects it
  }
  return count;
}

}  // namespace dashpot
