// What memory keeps of what sleeps, whose rows are not made, and loses of what was moved by hand.

#include <algorithm>
#include <cstddef>

#include "dashpot/rows/memory.hpp"

namespace dashpot {

bool MarkedRows::has_all(const std::array<int, 2>& geoms) const {
  for (int index : geoms)
    if (index < 0 || geom[index] == GeomMark::kOther) return false;
  return has_any(geoms);
}

bool MarkedRows::has_any(const std::array<int, 2>& geoms) const {
  return std::any_of(geoms.begin(), geoms.end(), [&](int index) {
    return index < 0 ? flex[-1 - index] : geom[index] == GeomMark::kMarked;
  });
}

void Memory::rest(const Tree& tree, int index) {
  if (layout_.held_trees == 0) return;
  held_motion().length[index] = 0.0;
  std::fill_n(end_velocity() + tree.dof_begin, tree.dof_count, 0.0);
}

void Memory::forget(const MarkedRows& moved) {
  int kept = 0;
  for (int i = 0; i < contact_count(); ++i) {
    if (moved.has_any(geoms(i))) continue;
    std::copy_n(contact_storage(i), kContactSize, contact_storage(kept++));
  }
  std::fill(contact_storage(kept), contact_storage(contact_count()), 0.0);
  storage_[0] = kept;
  for (int i = 0; i < layout_.constraints; ++i) {
    if (!moved.constraint[i]) continue;
    double* const slot = constraint_storage() + kConstraintSize * i;
    const double stiffness = constraint(i).stiffness;
    std::fill_n(slot, kConstraintSize, 0.0);
    slot[offsetof(RememberedConstraint, stiffness) / sizeof(double)] = stiffness;
  }
}

int Memory::count(const MarkedRows& sleeping) const {
  int count = 0;
  for (int i = 0; i < contact_count() && !sleeping.geom.empty(); ++i)
    count += sleeping.has_all(geoms(i));
  return count;
}

double Memory::energy(const MarkedRows& sleeping) const {
  const auto spring = [](double stiffness, double deformation) {
    return 0.5 * stiffness * deformation * deformation;
  };
  double sum = 0.0;
  for (int i = 0; i < contact_count() && !sleeping.geom.empty(); ++i) {
    if (!sleeping.has_all(geoms(i))) continue;
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

void Memory::forget_constraints(const MarkedRows& sleeping) {
  if (sleeping.constraint.empty()) {
    std::fill(constraint_storage(), contact_storage(0), 0.0);
    return;
  }
  for (int i = 0; i < layout_.constraints; ++i)
    if (!sleeping.constraint[i])
      std::fill_n(constraint_storage() + kConstraintSize * i, kConstraintSize, 0.0);
}

// Gathers the contacts that sleep before all others; returns how many.
int Memory::gather(const MarkedRows& sleeping) {
  int count = 0;
  for (int i = 0; i < contact_count() && !sleeping.geom.empty(); ++i) {
    if (!sleeping.has_all(geoms(i))) continue;
    double* const place = contact_storage(count++);
    if (place != contact_storage(i)) std::copy_n(contact_storage(i), kContactSize, place);
    place[offsetof(RememberedContact, source) / sizeof(double)] = -1.0;  // no step detects it
  }
  return count;
}

}  // namespace dashpot
