// Gravity of light parts, which goes to the middle of a step with the contacts.

#include "dashpot/integrate/trapezoid.hpp"
#include "dashpot/model/trees.hpp"
#include "dashpot/model/velocities.hpp"

namespace dashpot {

namespace {

// H^2 m g l / 2 I from which on gravity is that of the middle. From 1 on its Verlet corrector, a
// step late, feeds on itself; the others keep the energy of gravity better by it.
constexpr double kLightPart = 0.1;

}  // namespace

void Trapezoid::find_light_trees(const mjData_* d, const StepView& step, TreeMotion& motion) {
  const Trees& trees = motion.trees();
  light_.assign(trees.tree.size(), 0);
  frozen_at_.assign(trees.tree.size(), 0.0);
  for (const ContactInput& contact : step.contacts) {
    if (contact.ahead == 0.0) continue;
    for (int tree : contact.tree) {
      if (tree < 0) continue;
      double& at = frozen_at_[tree];
      at = at == 0.0 || at == contact.ahead ? contact.ahead : 0.5 * step.length;
    }
  }
  for (int index = 0; index < motion.tree_count(); ++index) {
    if (frozen_at_[index] == 0.0 || host::is_free_body(model_, index)) continue;
    motion.invert_inertia(d, index);
    light_[index] = host::has_light_part(model_, d, trees, index, step.length, kLightPart);
  }
}

void Trapezoid::load_gravity(const mjData_* d, const TreeMotion& motion, RowData& data) {
  const Trees& trees = motion.trees();
  gravity_load_.assign(potential_.size(), 0.0);
  for (int index = 0; index < motion.tree_count(); ++index) {
    if (!light_[index] || !holds(index)) continue;
    host::add_gravity_ahead(model_, d, index, frozen_at_[index], host::Gravity::kLessCompensation,
                            gravity_room_, gravity_load_.data());
    add_load(gravity_load_, index, trees, data);
  }
}

}  // namespace dashpot
