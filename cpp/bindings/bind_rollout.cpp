#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <utility>

#include "dashpot/mujoco/model_view.hpp"
#include "dashpot/mujoco/simple_inertia.hpp"
#include "dashpot/simulations/rollout.hpp"
#include "model_lock.hpp"
#include "signals.hpp"

namespace py = pybind11;

namespace dashpot::bindings {
namespace {

using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;

// The rollouts of an engine. Of threads that roll out at once one has the workers that are kept,
// the others make their own.
class SharedRollouts {
 public:
  SharedRollouts(std::uintptr_t model_address, std::shared_ptr<ModelLock> lock,
                 const Parameters& parameters)
      : model_(reinterpret_cast<mjModel_*>(model_address)),
        lock_(std::move(lock)),
        parameters_(parameters),
        kept_(parameters) {}

  py::tuple run(const Array& initial_state, const std::optional<Array>& control, int nstep,
                int nthread, bool with_memory, bool differentiable) {
    const ModelSizes sizes = sizes_of(model_);
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
    input.record = with_memory ? input.kind : StateKind::kFullPhysics;
    input.initial_state = initial_state.data();
    input.differentiable = differentiable;
    if (control) {
      if (control->ndim() != 3 || control->shape(0) != input.nbatch || control->shape(1) != nstep ||
          control->shape(2) != sizes.nu) {
        throw std::invalid_argument("control must be (nbatch, nstep, nu)");
      }
      input.control = control->data();
    }
    const auto batch = static_cast<py::ssize_t>(input.nbatch),
               steps = static_cast<py::ssize_t>(nstep);
    Array state({batch, steps, with_memory ? nstate : py::ssize_t(sizes.full_physics)});
    Array sensordata({batch, steps, static_cast<py::ssize_t>(sizes.nsensordata)});
    double* state_out = state.mutable_data();
    double* sensor_out = sensordata.mutable_data();
    {
      const py::gil_scoped_release release;
      std::unique_lock<ModelLock> alone(*lock_);
      host::follow_edited_masses(model_);  // here, for the workers share its arrays
      const host::ModelView view(model_);
      alone.unlock();
      const std::unique_lock<std::mutex> have_kept(using_kept_, std::try_to_lock);
      if (have_kept) {
        kept_.run(view.get(), input, nthread, state_out, sensor_out, handle_signals);
      } else {
        Rollouts(parameters_)
            .run(view.get(), input, nthread, state_out, sensor_out, handle_signals);
      }
    }
    return py::make_tuple(state, sensordata);
  }

 private:
  mjModel_* model_;
  std::shared_ptr<ModelLock> lock_;
  Parameters parameters_;
  std::mutex using_kept_;
  Rollouts kept_;
};

}  // namespace

void bind_rollout(py::module_& module) {
  py::class_<SharedRollouts>(module, "Rollouts", "Rolls out one model; see dashpot.rollout.")
      .def(py::init<std::uintptr_t, std::shared_ptr<ModelLock>, const Parameters&>(),
           py::arg("model_address"), py::arg("lock"), py::arg("parameters"))
      .def("run", &SharedRollouts::run, py::arg("initial_state"), py::arg("control"),
           py::arg("nstep"), py::arg("nthread"), py::arg("with_memory"),
           py::arg("differentiable") = false,
           "Roll out on threads, GIL released. Returns (state, sensordata). If `differentiable`,\n"
           "the last states have the second half of their velocities, which the next step would\n"
           "add, and no motion is small.");
}

}  // namespace dashpot::bindings
