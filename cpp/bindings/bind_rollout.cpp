#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "dashpot/mujoco/model_checks.hpp"
#include "dashpot/mujoco/model_view.hpp"
#include "dashpot/mujoco/simple_inertia.hpp"
#include "dashpot/simulations/rollout.hpp"
#include "model_lock.hpp"
#include "without_gil.hpp"

namespace py = pybind11;

namespace dashpot::bindings {
namespace {

using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;
using Output = py::array_t<double, py::array::c_style>;

// What rollouts of an engine step with.
class RolloutWorkers {
 public:
  RolloutWorkers(std::uintptr_t model_address, std::shared_ptr<ModelLock> lock,
                 const Parameters& parameters)
      : model_(reinterpret_cast<mjModel_*>(model_address)),
        lock_(std::move(lock)),
        simulations_(parameters) {}

  const mjModel_* model() const { return model_; }
  SimulationPool& simulations() { return simulations_; }

  // The model as it is between steps.
  host::ModelView view() {
    const std::lock_guard<ModelLock> alone(*lock_);
    host::check_values(model_);
    host::follow_edited_masses(model_);  // here, for simulations share its arrays
    return host::ModelView(model_);
  }

 private:
  mjModel_* model_;
  std::shared_ptr<ModelLock> lock_;
  SimulationPool simulations_;
};

void require_shape(const char* name, const py::array& array, std::vector<py::ssize_t> shape) {
  bool fits = array.ndim() == static_cast<py::ssize_t>(shape.size());
  for (std::size_t i = 0; fits && i < shape.size(); ++i) fits = array.shape(i) == shape[i];
  if (!fits) throw std::invalid_argument(std::string(name) + " has the wrong shape");
}

using Diverged = std::vector<std::tuple<int, int, std::string>>;  // rollout, step, what

Diverged run(const std::vector<RolloutWorkers*>& workers, const Array& initial_state,
             const std::optional<Array>& control, int control_spec, int nthread,
             bool differentiable, bool fills_diverged, Output state, Output sensordata) {
  const ModelSizes sizes = sizes_of(workers.at(0)->model());
  if (state.ndim() != 3) throw std::invalid_argument("state must be 3-D");
  const py::ssize_t nbatch = state.shape(0), nstep = state.shape(1);
  const auto kind_of = [&](py::ssize_t nstate) {
    if (nstate == sizes.full_physics) return StateKind::kFullPhysics;
    if (nstate == sizes.integration) return StateKind::kIntegration;
    throw std::invalid_argument("states have rows of neither state size");
  };
  RolloutInput input;
  input.nbatch = static_cast<int>(nbatch);
  input.nstep = static_cast<int>(nstep);
  input.kind = kind_of(initial_state.shape(initial_state.ndim() - 1));
  input.record = kind_of(state.shape(2));
  input.initial_state = initial_state.data();
  input.control_spec = control_spec;
  input.differentiable = differentiable;
  input.fills_diverged = fills_diverged;
  require_shape("initial_state", initial_state, {nbatch, initial_state.shape(1)});
  require_shape("sensordata", sensordata, {nbatch, nstep, py::ssize_t(sizes.nsensordata)});
  if (control) {
    input.ncontrol = input_size(workers[0]->model(), control_spec);
    require_shape("control", *control, {nbatch, nstep, py::ssize_t(input.ncontrol)});
    input.control = control->data();
  }
  double* const state_out = state.mutable_data();
  double* const sensor_out = sensordata.mutable_data();

  const WithoutGil without_gil;
  std::map<RolloutWorkers*, host::ModelView> views;
  std::vector<RolloutModel> models;
  for (RolloutWorkers* each : workers) {
    auto found = views.find(each);
    if (found == views.end()) found = views.emplace(each, each->view()).first;
    models.push_back({found->second.get(), &each->simulations()});
  }
  Diverged diverged;
  for (const Divergence& each :
       roll_out(models, input, nthread, state_out, sensor_out, handle_signals))
    diverged.emplace_back(each.rollout, each.step, each.what);
  return diverged;
}

}  // namespace

void bind_rollout(py::module_& module) {
  py::class_<RolloutWorkers>(module, "RolloutWorkers",
                             "What rollouts of an engine step with, kept from call to call.")
      .def(py::init<std::uintptr_t, std::shared_ptr<ModelLock>, const Parameters&>(),
           py::arg("model_address"), py::arg("lock"), py::arg("parameters"));
  module.def(
      "roll_out", &run, py::arg("workers"), py::arg("initial_state"), py::arg("control"),
      py::arg("control_spec"), py::arg("nthread"), py::arg("differentiable"),
      py::arg("fills_diverged"), py::arg("state").noconvert(), py::arg("sensordata").noconvert(),
      "Roll out on threads, GIL released, and write states and sensor data; see\n"
      "dashpot.rollout. `workers`: one for all rollouts, or one for each. If\n"
      "`differentiable`, the last states have the second half of their velocities, which the\n"
      "next step would add, and no motion is small. If `fills_diverged`, what diverges is NaN "
      "from\n"
      "there on, and (rollout, step, what) of each is returned.");
}

}  // namespace dashpot::bindings
