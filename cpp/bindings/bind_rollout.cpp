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

#include "dashpot/model/body_inertia.hpp"
#include "dashpot/model/checks.hpp"
#include "dashpot/model/state.hpp"
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

// An array that takes the numbers over, and the room that they do not need away.
template <typename Number>
py::array_t<Number> array_of(std::vector<Number>&& numbers) {
  numbers.shrink_to_fit();
  auto* const kept = new std::vector<Number>(std::move(numbers));
  const py::capsule owner(kept, [](void* p) { delete static_cast<std::vector<Number>*>(p); });
  return py::array_t<Number>(kept->size(), kept->data(), owner);
}

py::tuple run(const std::vector<RolloutWorkers*>& workers, const Array& initial_state,
              int initial_spec, const std::optional<Array>& control, int control_spec, int nthread,
              bool differentiable, bool fills_diverged, std::optional<Output> state,
              Output sensordata, std::optional<Output> last_state) {
  const ModelSizes sizes = sizes_of(workers.at(0)->model());
  if (sensordata.ndim() != 3) throw std::invalid_argument("sensordata must be 3-D");
  const py::ssize_t nbatch = sensordata.shape(0), nstep = sensordata.shape(1);
  const auto kind_of = [&](const py::array& states) {
    const py::ssize_t nstate = states.shape(states.ndim() - 1);
    if (nstate == sizes.full_physics) return kFullPhysics;
    if (nstate == sizes.integration) return kIntegration;
    throw std::invalid_argument("states have rows of neither state size");
  };
  RolloutInput input;
  input.nbatch = static_cast<int>(nbatch);
  input.nstep = static_cast<int>(nstep);
  input.spec = initial_spec;
  input.initial_state = initial_state.data();
  input.control_spec = control_spec;
  input.differentiable = differentiable;
  input.fills_diverged = fills_diverged;
  const py::ssize_t nstate = state_size(workers[0]->model(), initial_spec);
  require_shape("initial_state", initial_state, {nbatch, nstate});
  require_shape("sensordata", sensordata, {nbatch, nstep, py::ssize_t(sizes.nsensordata)});
  if (control) {
    input.ncontrol = state_size(workers[0]->model(), control_spec);
    require_shape("control", *control, {nbatch, nstep, py::ssize_t(input.ncontrol)});
    input.control = control->data();
  }
  RolloutOutput output;
  output.sensordata = sensordata.mutable_data();
  std::vector<SparseRows> sparse(state ? 0 : nbatch);
  if (state) {
    output.record = kind_of(*state);
    require_shape("state", *state, {nbatch, nstep, state->shape(state->ndim() - 1)});
    output.state = state->mutable_data();
  } else {
    output.sparse = sparse.data();
  }
  if (last_state) {
    require_shape("last_state", *last_state, {nbatch, py::ssize_t(sizes.integration)});
    output.last_state = last_state->mutable_data();
  }

  Diverged diverged;
  {
    const WithoutGil without_gil;
    std::map<RolloutWorkers*, host::ModelView> views;
    std::vector<RolloutModel> models;
    for (RolloutWorkers* each : workers) {
      auto found = views.find(each);
      if (found == views.end()) found = views.emplace(each, each->view()).first;
      models.push_back({found->second.get(), &each->simulations()});
    }
    for (const Divergence& each : roll_out(models, input, output, nthread, handle_signals))
      diverged.emplace_back(each.rollout, each.step, each.what);
  }
  py::list rows;
  for (SparseRows& each : sparse)
    rows.append(py::make_tuple(array_of(std::move(each.value)), array_of(std::move(each.place)),
                               array_of(std::move(each.row_end))));
  return py::make_tuple(diverged, rows);
}

}  // namespace

void bind_rollout(py::module_& module) {
  py::class_<RolloutWorkers>(module, "RolloutWorkers",
                             "What rollouts of an engine step with, kept from call to call.")
      .def(py::init<std::uintptr_t, std::shared_ptr<ModelLock>, const Parameters&>(),
           py::arg("model_address"), py::arg("lock"), py::arg("parameters"));
  module.def(
      "roll_out", &run, py::arg("workers"), py::arg("initial_state"), py::arg("initial_spec"),
      py::arg("control"), py::arg("control_spec"), py::arg("nthread"), py::arg("differentiable"),
      py::arg("fills_diverged"), py::arg("state").noconvert(), py::arg("sensordata").noconvert(),
      py::arg("last_state").noconvert(),
      "Roll out on threads, GIL released, and write states and sensor data; see\n"
      "dashpot.rollout. `workers`: one for all rollouts, or one for each. `initial_spec`: what\n"
      "`initial_state` holds, bits of mjtState. If\n"
      "`differentiable`, the last states have the second half of their velocities, which the\n"
      "next step would add, and no motion is small. If `fills_diverged`, what diverges is NaN "
      "from\n"
      "there on. Returns (rollout, step, what) of each that did, and, where `state` is None,\n"
      "(values, places, ends) of the integration states of each: rows without their zeros.");
}

}  // namespace dashpot::bindings
