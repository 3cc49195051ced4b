// Data that are made here, not by users.

#pragma once

#include <memory>

struct mjModel_;
struct mjData_;

namespace dashpot::host {

struct DataDeleter {
  void operator()(mjData_* d) const;
};
using OwnedData = std::unique_ptr<mjData_, DataDeleter>;

// Throws MujocoError where there is no memory for them.
OwnedData make_data(const mjModel_* m);

}  // namespace dashpot::host
