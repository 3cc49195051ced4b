#include "dashpot/mujoco_owned.hpp"

#include <mujoco/mujoco.h>

#include "dashpot/mujoco_errors.hpp"

namespace dashpot::host {

void ModelDeleter::operator()(mjModel_* m) const { mj_deleteModel(m); }
void DataDeleter::operator()(mjData_* d) const { mj_deleteData(d); }

OwnedModel copy_model(const mjModel_* m) {
  const ErrorGuard guard;
  OwnedModel copy(mj_copyModel(nullptr, m));
  if (!copy) throw MujocoError("MuJoCo could not copy the model");
  return copy;
}

OwnedData make_data(const mjModel_* m) {
  const ErrorGuard guard;
  OwnedData data(mj_makeData(m));
  if (!data) throw MujocoError("MuJoCo could not make data for the model");
  return data;
}

}  // namespace dashpot::host
