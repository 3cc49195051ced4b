#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cstdint>
#include <mutex>
#include <optional>
#include <stdexcept>

#include "dashpot/rollout.hpp"
#include "model_lock.hpp"

namespace py = pybind11;

namespace dashpot::bindings {
namespace {

using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;

py::tuple rollout_arrays(std::uintptr_t model_address, ModelLock& lock,
                         const Parameters& parameters, const Array& initial_state,
                         const std::optional<Array>& control, int nstep, int nthread) {
  const auto* model = reinterpret_cast<const mjModel_*>(model_address);
  const ModelSizes sizes = sizes_of(model);
  if (initial_state.ndim() != 2) throw std::invalid_argument("initial_state must be 2-D");
  if (nstep < 1) throw std::invalid_argument("nstep must be >= 1");

  RolloutInput input;
  input.nbatch = static_cast<int>(initial_state.shape(0));
  input.nstep = nstep;
  const py::ssize_t nstate = initial_state.shape(1);
  if (nstate == sizes.full_physics) {
    input.kind = StateKind::kFullPhysics;
  } else if (nstate == sizes.integration) {
    input.kind = StateKind::kIntegration;
  } else {
    throw std::invalid_argument("initial_state has rows of neither state size");
  }
  input.initial_state = initial_state.data();
  if (control) {
    if (control->ndim() != 3 || control->shape(0) != input.nbatch || control->shape(1) != nstep ||
        control->shape(2) != sizes.nu) {
      throw std::invalid_argument("control must be (nbatch, nstep, nu)");
    }
    input.control = control->data();
  }
  Array state({static_cast<py::ssize_t>(input.nbatch), static_cast<py::ssize_t>(nstep), nstate});
  Array sensordata({static_cast<py::ssize_t>(input.nbatch), static_cast<py::ssize_t>(nstep),
                    static_cast<py::ssize_t>(sizes.nsensordata)});
  double* state_out = state.mutable_data();
  double* sensor_out = sensordata.mutable_data();
  {
    const py::gil_scoped_release release;
    std::unique_lock<ModelLock> alone(lock);
    const ModelCopy copy(model);
    alone.unlock();
    rollout(copy.get(), parameters, input, nthread, state_out, sensor_out);
  }
  return py::make_tuple(state, sensordata);
}

}  // namespace

void bind_rollout(py::module_& module) {
  module.def(
      "rollout", &rollout_arrays, py::arg("model_address"), py::arg("lock"), py::arg("parameters"),
      py::arg("initial_state"), py::arg("control"), py::arg("nstep"), py::arg("nthread"),
      "Roll out on threads, GIL released; see dashpot.rollout. Returns (state, sensordata).");
}

}  // namespace dashpot::bindings
