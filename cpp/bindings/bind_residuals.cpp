#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <array>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "dashpot/mujoco/model_checks.hpp"
#include "dashpot/mujoco/simple_inertia.hpp"
#include "dashpot/simulations/residuals.hpp"
#include "without_gil.hpp"

namespace py = pybind11;

namespace dashpot::bindings {
namespace {

using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;
// Address of an mjModel and the parameters, None for mj_step.
using PyVariant = std::pair<std::uintptr_t, const Parameters*>;
// Address in sensordata, whether it is a mean, weight.
using Channel = std::tuple<int, bool, double>;

std::vector<double> to_vector(const Array& array) {
  return std::vector<double>(array.data(), array.data() + array.size());
}

// Models follow their edits here, for the workers share their arrays.
std::vector<Variant> to_variants(const std::vector<PyVariant>& variants) {
  std::vector<Variant> result;
  for (const auto& [address, parameters] : variants) {
    auto* const model = reinterpret_cast<mjModel_*>(address);
    if (parameters) {
      host::check_values(model);
      host::follow_edited_masses(model);
    }
    result.push_back({model, parameters});
  }
  return result;
}

// Runs `function` (residuals or observe) into a new array (variants, `columns`...).
template <typename Function>
Array run(const std::vector<PyVariant>& py_variants,
          const std::vector<ObservedTrajectory>& trajectories, const Array& qpos, const Array& qvel,
          int nthread, const std::vector<py::ssize_t>& columns, Function function) {
  const std::vector<Variant> variants = to_variants(py_variants);
  if (variants.empty() || trajectories.empty()) {
    throw std::invalid_argument("at least one variant and one trajectory are needed");
  }
  const ModelSizes sizes = sizes_of(variants.front().model);
  const auto fits = [&](const Array& array, int size) {
    return array.ndim() == 3 && array.shape(0) == py::ssize_t(variants.size()) &&
           array.shape(1) == py::ssize_t(trajectories.size()) && array.shape(2) == size;
  };
  if (!fits(qpos, sizes.nq)) {
    throw std::invalid_argument("qpos must be (variants, trajectories, nq)");
  }
  if (!fits(qvel, sizes.nv)) {
    throw std::invalid_argument("qvel must be (variants, trajectories, nv)");
  }
  std::vector<py::ssize_t> shape = {py::ssize_t(variants.size())};
  shape.insert(shape.end(), columns.begin(), columns.end());
  Array result(shape);
  double* out = result.mutable_data();
  const double* qpos_in = qpos.data();
  const double* qvel_in = qvel.data();
  {
    const WithoutGil without_gil;
    function(variants, trajectories, qpos_in, qvel_in, nthread, out, handle_signals);
  }
  return result;
}

}  // namespace

void bind_residuals(py::module_& module) {
  py::class_<ObservedTrajectory>(module, "ObservedTrajectory",
                                 "What was observed of one motion, in simulation steps.")
      .def(py::init([](std::string name, double timestep, std::vector<int> frame_step,
                       std::vector<int> body, const Array& position, const Array& quaternion,
                       const Array& control, std::array<double, 3> position_weight,
                       double rotation_weight, const std::vector<Channel>& channel,
                       const Array& reading, int interval) {
             ObservedTrajectory trajectory;
             trajectory.name = std::move(name);
             trajectory.timestep = timestep;
             trajectory.frame_step = std::move(frame_step);
             trajectory.body = std::move(body);
             trajectory.position = to_vector(position);
             trajectory.quaternion = to_vector(quaternion);
             trajectory.control = to_vector(control);
             trajectory.position_weight = position_weight;
             trajectory.rotation_weight = rotation_weight;
             for (const auto& [address, mean, weight] : channel) {
               trajectory.channel.push_back({address, mean, weight});
             }
             trajectory.reading = to_vector(reading);
             trajectory.interval = interval;
             return trajectory;
           }),
           py::kw_only(), py::arg("name"), py::arg("timestep"), py::arg("frame_step"),
           py::arg("body"), py::arg("position"), py::arg("quaternion"), py::arg("control"),
           py::arg("position_weight"), py::arg("rotation_weight"), py::arg("channel"),
           py::arg("reading"), py::arg("interval"))
      .def_readonly("name", &ObservedTrajectory::name)
      .def_property_readonly("residuals", &ObservedTrajectory::residuals);

  module.def(
      "residuals",
      [](const std::vector<PyVariant>& variants,
         const std::vector<ObservedTrajectory>& trajectories, const Array& qpos, const Array& qvel,
         int nthread) {
        return run(variants, trajectories, qpos, qvel, nthread,
                   {py::ssize_t(residual_count(trajectories))}, residuals);
      },
      py::arg("variants"), py::arg("trajectories"), py::arg("qpos"), py::arg("qvel"),
      py::arg("nthread"),
      "Residuals (variants, n) of all (model address, Parameters or None) x trajectories, on\n"
      "threads with the GIL released. Within a trajectory: (frames, bodies, 6), position first,\n"
      "then (frames, channels).");
  module.def(
      "observe",
      [](const std::vector<PyVariant>& variants,
         const std::vector<ObservedTrajectory>& trajectories, const Array& qpos, const Array& qvel,
         int nthread) {
        return run(variants, trajectories, qpos, qvel, nthread,
                   {py::ssize_t(observation_count(trajectories))}, observe);
      },
      py::arg("variants"), py::arg("trajectories"), py::arg("qpos"), py::arg("qvel"),
      py::arg("nthread"),
      "What is simulated (variants, n). Within a trajectory: poses (frames, bodies, 7), position\n"
      "(m) and quaternion (w x y z), then sensors (frames, channels).");
}

}  // namespace dashpot::bindings
