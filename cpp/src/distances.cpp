#include "dashpot/distances.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <stdexcept>

#include "dashpot/geometry_host.hpp"
#include "dashpot/parallel.hpp"
#include "dashpot/query.hpp"

namespace dashpot {

namespace {

struct DataDeleter {
  void operator()(mjData* data) const { mj_deleteData(data); }
};

}  // namespace

std::vector<Distance> geom_distances(const mjModel* model, int geom1, int geom2, const double* qpos,
                                     int count, int nthread) {
  const Shape shape1 = geom_shape(model, geom1), shape2 = geom_shape(model, geom2);
  const int threads = thread_count(nthread, count);
  std::vector<std::unique_ptr<mjData, DataDeleter>> data(threads);
  for (auto& own : data) {
    own.reset(mj_makeData(model));
    if (!own) throw std::runtime_error("MuJoCo could not make data for the model");
  }
  std::vector<Distance> result(count);
  parallel_for(count, threads, [&](int worker, int item) {
    mjData* own = data[worker].get();
    std::copy_n(qpos + std::size_t(item) * model->nq, model->nq, own->qpos);
    mj_kinematics(model, own);
    result[item] =
        distance(shape1, geom_pose(model, own, geom1), shape2, geom_pose(model, own, geom2));
  });
  return result;
}

}  // namespace dashpot
