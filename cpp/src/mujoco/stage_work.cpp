#include "dashpot/mujoco/stage_work.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>

#include "dashpot/mujoco/forces.hpp"

namespace dashpot::host {

void StageWork::find(const mjModel_* m, mjData_* d, const RungeKutta& stages,
                     const std::vector<double>& start_velocity, const std::vector<double>& beyond) {
  const StageForces& forces = stages.forces();
  of_rows_.resize(m->nv);
  for (int i = 0; i < m->nv; ++i) {
    const double way = m->opt.timestep * stages.mean_velocity()[i];
    const double with_potential = potential_force(m, d, i) - d->qfrc_gravcomp[i];
    const double others = forces.driving.mean[i] + forces.damping.mean[i];
    of_rows_[i] = forces.rows.mean[i] * way + forces.rows.work_of_changes[i] -
                  (with_potential + others) * beyond[i];
  }
  if (std::any_of(beyond.begin(), beyond.end(), [](double way) { return way != 0.0; }))
    add_change_of_inertia(m, d, start_velocity, beyond);
}

// C(b, u) is (c(u + b / H) - c(u - b / H)) H / 4, which weight takes no part in. Leaves what was
// computed from velocities as it was.
void StageWork::add_change_of_inertia(const mjModel_* m, mjData_* d,
                                      const std::vector<double>& start_velocity,
                                      const std::vector<double>& beyond) {
  const double step = m->opt.timestep;
  velocity_.assign(d->qvel, d->qvel + m->nv);
  const auto find_bias = [&](double per_way, std::vector<double>& bias) {
    for (int i = 0; i < m->nv; ++i) d->qvel[i] = velocity_[i] + per_way * beyond[i];
    bias.resize(m->nv);
    mj_comVel(m, d);
    mj_rne(m, d, 0, bias.data());
  };
  find_bias(1.0 / step, bias_ahead_);
  find_bias(-1.0 / step, bias_behind_);
  for (int i = 0; i < m->nv; ++i)
    of_rows_[i] += 0.25 * step * velocity_[i] * (bias_ahead_[i] - bias_behind_[i]);
  std::copy(start_velocity.begin(), start_velocity.end(), d->qvel);
  mj_comVel(m, d);
  std::copy(velocity_.begin(), velocity_.end(), d->qvel);
}

}  // namespace dashpot::host
