#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cstdint>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "dashpot/model/body_inertia.hpp"
#include "dashpot/model/checks.hpp"
#include "dashpot/simulations/recordings.hpp"
#include "without_gil.hpp"

namespace py = pybind11;

namespace dashpot::bindings {
namespace {

using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;
// Address of an mjModel and the parameters, None for mj_step.
using PyVariant = std::pair<std::uintptr_t, const Parameters*>;

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

int checked_index(const char* what, int index, std::size_t count) {
  if (index < 0 || std::size_t(index) >= count) {
    throw std::invalid_argument(std::string(what) + " " + std::to_string(index) +
                                " of an item is out of range");
  }
  return index;
}

// Returns the readings of all items in a row, and why each failed ("": it did not).
std::pair<Array, std::vector<std::string>> run(const std::vector<PyVariant>& py_variants,
                                               const std::vector<Recording>& recordings,
                                               const std::vector<std::pair<int, int>>& py_items,
                                               const Array& qpos, const Array& qvel, int nthread) {
  const std::vector<Variant> variants = to_variants(py_variants);
  if (variants.empty() || recordings.empty()) {
    throw std::invalid_argument("at least one variant and one recording are needed");
  }
  const ModelSizes sizes = sizes_of(variants.front().model);
  const auto check = [&](const char* name, const Array& array, int size) {
    if (array.ndim() != 2 || array.shape(0) != py::ssize_t(py_items.size()) ||
        array.shape(1) != size) {
      throw std::invalid_argument(std::string(name) + " must be (items, " + std::to_string(size) +
                                  ")");
    }
  };
  check("qpos", qpos, sizes.nq);
  check("qvel", qvel, sizes.nv);
  std::vector<Item> items;
  py::ssize_t size = 0;
  for (const auto& [variant, recording] : py_items) {
    const auto i = items.size();
    items.push_back({checked_index("variant", variant, variants.size()),
                     checked_index("recording", recording, recordings.size()),
                     qpos.data() + i * sizes.nq, qvel.data() + i * sizes.nv});
    size += recordings[recording].size();
  }
  Array readings(size);
  double* out = readings.mutable_data();
  std::vector<std::string> failures;
  {
    const WithoutGil without_gil;
    failures = record(variants, recordings, items, nthread, out, handle_signals);
  }
  return {readings, failures};
}

}  // namespace

void bind_recordings(py::module_& module) {
  py::class_<Recording>(module, "Recording", "What is read of one motion, in simulation steps.")
      .def(py::init([](std::string name, double timestep, std::vector<int> record_step,
                       std::vector<int> body, const std::vector<std::pair<int, bool>>& channel,
                       std::vector<std::pair<int, int>> gap, const Array& control, int interval) {
             Recording recording;
             recording.name = std::move(name);
             recording.timestep = timestep;
             recording.record_step = std::move(record_step);
             recording.body = std::move(body);
             for (const auto& [address, mean] : channel)
               recording.channel.push_back({address, mean});
             recording.gap = std::move(gap);
             recording.control.assign(control.data(), control.data() + control.size());
             recording.interval = interval;
             return recording;
           }),
           py::kw_only(), py::arg("name"), py::arg("timestep"), py::arg("record_step"),
           py::arg("body"), py::arg("channel"), py::arg("gap"), py::arg("control"),
           py::arg("interval"))
      .def_readonly("name", &Recording::name)
      .def_property_readonly("shape", [](const Recording& recording) {
        return std::make_pair(int(recording.record_step.size()), recording.row());
      });

  module.def(
      "record", &run, py::arg("variants"), py::arg("recordings"), py::arg("items"), py::arg("qpos"),
      py::arg("qvel"), py::arg("nthread"),
      "What simulations show: items are (variant, recording), variants (model address,\n"
      "Parameters or None), qpos (items, nq), qvel (items, nv). Returns the readings of all\n"
      "items in a row, each of its recording's shape: poses (bodies, 7), then channels,\n"
      "then the gap. By item it says why it failed, empty where it did not.");
}

}  // namespace dashpot::bindings
