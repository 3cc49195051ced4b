#include "dashpot/mujoco/owned.hpp"

#include <mujoco/mujoco.h>

#include "dashpot/mujoco/errors.hpp"

namespace dashpot::host {

void DataDeleter::operator()(mjData_* d) const { mj_deleteData(d); }

OwnedData make_data(const mjModel_* m) {
  const ErrorGuard guard;
  OwnedData data(mj_makeData(m));
  if (!data) throw MujocoError("MuJoCo could not make data for the model");
  return data;
}

}  // namespace dashpot::host
