// What drives do on a tree in flight in the Verlet corrector of a step, and how the tree responds.

#include <algorithm>

#include "dashpot/integrate/trapezoid.hpp"
#include "dashpot/model/effective_inertia.hpp"

namespace dashpot {

// The response of a tree to a force, or impulse, with the e D that its inertia had in the last step
// (model/effective_inertia.hpp); `response`: zeros before.
void Trapezoid::respond(const mjData_* d, const Trees& trees, int index, const HeldMotion& before,
                        const double* force, double* response) const {
  const Tree& t = trees.tree[index];
  if (!differs_in_damping(trees, index, before)) return add_response(trees, index, force, response);
  std::copy_n(force, t.dof_count, response);
  host::solve_damped(model_, d, trees, index, before.implicit_time[index], response);
}

bool Trapezoid::differs_in_damping(const Trees& trees, int index, const HeldMotion& before) {
  const Tree& t = trees.tree[index];
  const double implicit_time = before.implicit_time[index];
  return t.damped && !t.elastic && implicit_time > 0.0 && implicit_time != t.implicit_time;
}

// Work (J) that changes of drives, which may be jumps, do on a tree in flight: as the last part of
// its Verlet corrector.
double Trapezoid::work_of_drives(const mjData_* d, const Trees& trees, int index,
                                 const HeldMotion& before, const std::vector<double>& velocity) {
  const Tree& t = trees.tree[index];
  double* impulse = force_.data() + t.begin;
  for (int i = 0; i < t.dof_count; ++i)
    impulse[i] = 0.5 * before.length[index] * drives_.followed_change(t.dof_begin + i);
  load_response_.assign(t.count, 0.0);
  respond(d, trees, index, before, impulse, load_response_.data());
  double work = 0.0;
  for (int i = 0; i < t.dof_count; ++i)
    work += impulse[i] *
            (velocity[t.dof_begin + i] + generalized_[t.dof_begin + i] - 0.5 * load_response_[i]);
  return work;
}

}  // namespace dashpot
