#include "dashpot/simulations/distances.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cstddef>

#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/model/errors.hpp"
#include "dashpot/model/state.hpp"

namespace dashpot {

namespace {

struct GeomShapePair {
  GeomShapePair(const mjModel* model, int first, int second)
      : geom1(first),
        geom2(second),
        shape1(geom_shape(model, first)),
        shape2(geom_shape(model, second)) {}

  int geom1, geom2;
  Shape shape1, shape2;
};

// Calls task(data, item) for every item, each worker with data of its own.
template <typename Task>
void for_each_state(const mjModel* model, int count, int nthread, const Interrupt& interrupt,
                    const Task& task) {
  const int threads = thread_count(nthread, count);
  std::vector<host::OwnedData> data;
  for (int worker = 0; worker < threads; ++worker) data.push_back(host::make_data(model));
  parallel_for(count, threads, interrupt,
               [&](const Worker& worker, int item) { task(data[worker.index()].get(), item); });
}

Distance distance_at(const mjModel* model, const mjData* data, const GeomShapePair& pair) {
  const Pose pose1 = geom_pose(model, data, pair.geom1);  // errors name the first geom first
  const Pose pose2 = geom_pose(model, data, pair.geom2);
  return distance(pair.shape1, pose1, pair.shape2, pose2);
}

TimeOfImpact impact_at(const mjModel* model, const mjData* data, const GeomShapePair& pair,
                       double horizon) {
  const Pose pose1 = geom_pose(model, data, pair.geom1);
  const Pose pose2 = geom_pose(model, data, pair.geom2);
  const Motion motion1 = geom_motion(model, data, pair.geom1);
  const Motion motion2 = geom_motion(model, data, pair.geom2);
  try {
    return time_of_impact(pair.shape1, pose1, motion1, pair.shape2, pose2, motion2, horizon);
  } catch (const UndecidedImpact& undecided) {
    throw UndecidedImpact(host::contact_side(model, pair.geom1) + " and " +
                          host::contact_side(model, pair.geom2) + ": " + undecided.what());
  }
}

}  // namespace

Distance geom_distance(const mjModel* model, const mjData* data, int geom1, int geom2) {
  return distance_at(model, data, GeomShapePair(model, geom1, geom2));
}

TimeOfImpact geom_time_of_impact(const mjModel* model, const mjData* data, int geom1, int geom2,
                                 double horizon) {
  return impact_at(model, data, GeomShapePair(model, geom1, geom2), horizon);
}

std::vector<Distance> geom_distances(const mjModel* model, int geom1, int geom2, const double* qpos,
                                     int count, int nthread, const Interrupt& interrupt) {
  const GeomShapePair pair(model, geom1, geom2);
  std::vector<Distance> result(count);
  for_each_state(model, count, nthread, interrupt, [&](mjData* data, int item) {
    std::copy_n(qpos + std::size_t(item) * model->nq, model->nq, data->qpos);
    mj_kinematics(model, data);
    result[item] = distance_at(model, data, pair);
  });
  return result;
}

std::vector<TimeOfImpact> geom_times_of_impact(const mjModel* model, int geom1, int geom2,
                                               const double* qpos, const double* qvel, int count,
                                               double horizon, int nthread,
                                               const Interrupt& interrupt) {
  const GeomShapePair pair(model, geom1, geom2);
  std::vector<TimeOfImpact> result(count);
  for_each_state(model, count, nthread, interrupt, [&](mjData* data, int item) {
    std::copy_n(qpos + std::size_t(item) * model->nq, model->nq, data->qpos);
    std::copy_n(qvel + std::size_t(item) * model->nv, model->nv, data->qvel);
    mj_kinematics(model, data);
    mj_comPos(model, data);
    mj_comVel(model, data);
    result[item] = impact_at(model, data, pair, horizon);
  });
  return result;
}

}  // namespace dashpot
