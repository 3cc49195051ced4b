// Models and data that are made here, not by users. Part of the mujoco_host room.

#pragma once

#include <memory>

struct mjModel_;
struct mjData_;

namespace dashpot::host {

struct ModelDeleter {
  void operator()(mjModel_* m) const;
};
struct DataDeleter {
  void operator()(mjData_* d) const;
};
using OwnedModel = std::unique_ptr<mjModel_, ModelDeleter>;
using OwnedData = std::unique_ptr<mjData_, DataDeleter>;

// Throw MujocoError where there is no memory for them.
OwnedModel copy_model(const mjModel_* m);
OwnedData make_data(const mjModel_* m);

}  // namespace dashpot::host
