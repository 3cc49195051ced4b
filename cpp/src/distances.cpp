#include "dashpot/distances.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cstddef>

#include "dashpot/geometry_host.hpp"
#include "dashpot/mujoco_owned.hpp"
#include "dashpot/parallel.hpp"

namespace dashpot {

namespace {

// Calls task(data, item) for every item, each worker with data of its own.
template <typename Task>
void for_each_state(const mjModel* model, int count, int nthread, const Task& task) {
  const int threads = thread_count(nthread, count);
  std::vector<host::OwnedData> data;
  for (int worker = 0; worker < threads; ++worker) data.push_back(host::make_data(model));
  parallel_for(count, threads, [&](int worker, int item) { task(data[worker].get(), item); });
}

}  // namespace

std::vector<Distance> geom_distances(const mjModel* model, int geom1, int geom2, const double* qpos,
                                     int count, int nthread) {
  const Shape shape1 = geom_shape(model, geom1), shape2 = geom_shape(model, geom2);
  std::vector<Distance> result(count);
  for_each_state(model, count, nthread, [&](mjData* data, int item) {
    std::copy_n(qpos + std::size_t(item) * model->nq, model->nq, data->qpos);
    mj_kinematics(model, data);
    result[item] =
        distance(shape1, geom_pose(model, data, geom1), shape2, geom_pose(model, data, geom2));
  });
  return result;
}

std::vector<TimeOfImpact> geom_times_of_impact(const mjModel* model, int geom1, int geom2,
                                               const double* qpos, const double* qvel, int count,
                                               double horizon, int nthread) {
  const Shape shape1 = geom_shape(model, geom1), shape2 = geom_shape(model, geom2);
  std::vector<TimeOfImpact> result(count);
  for_each_state(model, count, nthread, [&](mjData* data, int item) {
    std::copy_n(qpos + std::size_t(item) * model->nq, model->nq, data->qpos);
    std::copy_n(qvel + std::size_t(item) * model->nv, model->nv, data->qvel);
    mj_kinematics(model, data);
    mj_comPos(model, data);
    mj_comVel(model, data);
    result[item] = time_of_impact(
        shape1, geom_pose(model, data, geom1), geom_motion(model, data, geom1), shape2,
        geom_pose(model, data, geom2), geom_motion(model, data, geom2), horizon);
  });
  return result;
}

}  // namespace dashpot
