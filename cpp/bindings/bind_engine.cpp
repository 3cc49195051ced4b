// Engine: options, parameters, statistics, stepper, contact memory, model features.

#include <mujoco/mjdata.h>
#include <pybind11/native_enum.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <chrono>
#include <cstring>
#include <memory>
#include <mutex>
#include <utility>

#include "dashpot/model/checks.hpp"
#include "dashpot/model/errors.hpp"
#include "dashpot/model/features.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/model/state.hpp"
#include "dashpot/model/trees.hpp"
#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/trees.hpp"
#include "dashpot/step/contacts.hpp"
#include "dashpot/step/engine.hpp"
#include "dashpot/threads/parallel.hpp"
#include "dashpot/threads/team.hpp"
#include "model_lock.hpp"
#include "without_gil.hpp"

namespace py = pybind11;

namespace dashpot::bindings {

namespace {

mjModel_* model_at(std::uintptr_t address) { return reinterpret_cast<mjModel_*>(address); }
mjData_* data_at(std::uintptr_t address) { return reinterpret_cast<mjData_*>(address); }

// A stepper that Python threads may share, and other steppers of the same model with it.
class SharedStepper {
 public:
  SharedStepper(std::uintptr_t model, std::shared_ptr<ModelLock> lock, const Parameters& parameters,
                int nthread)
      : lock_(std::move(lock)), stepper_(model_at(model), parameters, nthread) {}

  StepStats step(std::uintptr_t address, int nstep) {
    mjData_* const data = data_at(address);
    warn_of_mj_step(data);
    try {
      const StepStats stats = step_without_gil(data, nstep);
      left_ = {data, data->timer[mjTIMER_STEP].number, data->time};
      return stats;
    } catch (const host::CallbackError&) {
      if (PyErr_Occurred()) throw py::error_already_set();
      throw;
    }
  }

 private:
  StepStats step_without_gil(mjData_* data, int nstep) {
    const WithoutGil without_gil;
    const std::lock_guard<ModelLock> alone(*lock_);
    auto asked = std::chrono::steady_clock::now();
    return stepper_.step(data, nstep, true, [&] {
      const auto now = std::chrono::steady_clock::now();
      if (now - asked < kInterruptInterval) return;
      asked = now;
      handle_signals();
    });
  }

  // mj_step1 counts as mj_step does, but leaves the time.
  void warn_of_mj_step(const mjData_* data) const {
    if (data != left_.data || data->timer[mjTIMER_STEP].number <= left_.mj_steps ||
        data->time <= left_.time)
      return;
    const char* const message =
        "mj_step moved these data since the last Engine.step: what it moved loses the friction and "
        "the compression that its contacts held; step data with one of the two";
    if (PyErr_WarnEx(PyExc_UserWarning, message, 2) < 0) throw py::error_already_set();
  }

  std::shared_ptr<ModelLock> lock_;
  Stepper stepper_;
  // Data as the last step left them.
  struct {
    const mjData_* data = nullptr;
    int mj_steps = 0;
    double time = 0.0;
  } left_;
};

template <typename T>
py::array_t<double> array(const std::vector<T>& rows, std::vector<py::ssize_t> shape) {
  py::array_t<double> result(shape);
  if (!rows.empty()) std::memcpy(result.mutable_data(), rows.data(), rows.size() * sizeof(T));
  return result;
}

py::tuple values(const StepStats& s) {
  return py::make_tuple(s.contacts, s.touching, s.islands, s.microsteps, s.clipped,
                        s.max_penetration, s.max_compression, s.cuts, s.parts);
}

py::dict contacts_dict(std::uintptr_t model, std::uintptr_t data, int contact_capacity) {
  const ContactReport report = report_contacts(model_at(model), data_at(data), contact_capacity);
  const py::ssize_t n = static_cast<py::ssize_t>(report.gap.size());
  py::array_t<int> geom({n, py::ssize_t(2)}), flex({n, py::ssize_t(2)});
  if (n > 0) std::memcpy(geom.mutable_data(), report.geom.data(), sizeof(int) * 2 * n);
  if (n > 0) std::memcpy(flex.mutable_data(), report.flex.data(), sizeof(int) * 2 * n);
  py::array_t<bool> sticking(n);
  for (py::ssize_t i = 0; i < n; ++i) sticking.mutable_at(i) = report.sticking[i] != 0;
  py::dict result;
  result["geom"] = geom;
  result["flex"] = flex;
  result["position"] = array(report.position, {n, 3});
  result["frame"] = array(report.frame, {n, 3, 3});
  result["gap"] = array(report.gap, {n});
  result["velocity"] = array(report.velocity, {n, 3});
  result["force"] = array(report.force, {n, 3});
  result["torque"] = array(report.torque, {n, 3});
  result["compression"] = array(report.compression, {n});
  result["displacement"] = array(report.displacement, {n, 3});
  result["sticking"] = sticking;
  return result;
}

py::dict energy_dict(std::uintptr_t model, std::uintptr_t data, std::uintptr_t scratch,
                     int contact_capacity) {
  const EnergyLedger ledger = read_ledger(model_at(model), data_at(data), contact_capacity);
  const auto [kinetic, potential] =
      mechanical_energy(model_at(model), data_at(data), data_at(scratch), contact_capacity);
  py::dict result;
  result["kinetic"] = kinetic;
  result["potential"] = potential;
  result["elastic"] = ledger.elastic;
  result["dissipated_normal"] = ledger.dissipated_normal;
  result["dissipated_friction"] = ledger.dissipated_friction;
  result["dissipated_constraint"] = ledger.dissipated_constraint;
  result["dissipated_recovery"] = ledger.dissipated_recovery;
  result["dissipated_damping"] = ledger.dissipated_damping;
  result["work"] = ledger.work;
  return result;
}

}  // namespace

void bind_engine(py::module_& module) {
  py::register_exception<DivergenceError>(module, "DivergenceError", PyExc_RuntimeError)
      .attr("__doc__") =
      "Motion or forces that are no numbers, or beyond what MuJoCo itself calls diverged.\n\n"
      "Names the tree or degree of freedom. Data are as they were before the step.\n\n"
      "Examples\n--------\n"
      ">>> wild = engine.make_data()\n"
      ">>> wild.qfrc_applied[0] = 1e12\n"
      ">>> try:\n"
      "...     stats = engine.step(wild, nstep=100)\n"
      "... except dashpot.DivergenceError as error:\n"
      "...     print(type(error).__bases__[0].__name__, wild.time)\n"
      "RuntimeError 0.0";

  py::native_enum<Law>(module, "Law", "enum.Enum")
      .value("kelvin_voigt", Law::kKelvinVoigt)
      .value("comfree", Law::kComFree)
      .finalize();

  py::native_enum<Impact>(module, "Impact", "enum.Enum")
      .value("none", Impact::kNone)
      .value("cut", Impact::kCut)
      .finalize();

  py::class_<Options>(module, "Options", "Options of the engine; see dashpot.Engine.")
      .def(py::init<>())
      .def_readwrite("law", &Options::law)
      .def_readwrite("microsteps", &Options::microsteps)
      .def_readwrite("max_microsteps", &Options::max_microsteps)
      .def_readwrite("recovery_speed", &Options::recovery_speed)
      .def_readwrite("mocap_timeconst", &Options::mocap_timeconst)
      .def_readwrite("impact", &Options::impact)
      .def_readwrite("rules", &Options::rules)
      .def_readwrite("comfree_stiffness", &Options::comfree_stiffness)
      .def_readwrite("comfree_damping", &Options::comfree_damping);

  py::class_<Parameters>(module, "Parameters", "Options and materials of a model.")
      .def(py::init<>())
      .def(py::init<const Parameters&>())
      .def_readwrite("options", &Parameters::options)
      .def_readwrite("geom_material", &Parameters::geom_material)
      .def_readwrite("pair_material", &Parameters::pair_material)
      .def_readwrite("contact_capacity", &Parameters::contact_capacity);

  py::class_<StepStats>(
      module, "StepStats",
      "What a call of step() did; counts of the last step unless said otherwise.\n\n"
      "Examples\n--------\n"
      ">>> stats = engine.step(engine.make_data(), nstep=20)\n"
      ">>> stats.clipped, stats.parts\n"
      "(0, 1)")
      .def_readonly(
          "contacts", &StepStats::contacts,
          "Contacts that could touch during the step; Engine.contacts has those that did.")
      .def_readonly("touching", &StepStats::touching, "Contacts that carried an impulse.")
      .def_readonly("islands", &StepStats::islands,
                    "Islands of trees joined by contacts, limits and equalities.")
      .def_readonly("microsteps", &StepStats::microsteps,
                    "Largest number of micro-steps of an island, maximum over all steps.")
      .def_readonly("clipped", &StepStats::clipped,
                    "Rows whose stiffness or damping was lowered, maximum over all steps.")
      .def_readonly("max_penetration", &StepStats::max_penetration,
                    "Deepest overlap at the start of any step, m; it begins at the margin that a "
                    "model gives a contact.")
      .def_readonly("max_compression", &StepStats::max_compression,
                    "Deepest compression of a spring at the end of any step, m.")
      .def_readonly("cuts", &StepStats::cuts, "Cuts at impacts, sum over all steps.")
      .def_readonly(
          "parts", &StepStats::parts,
          "Parts that a step was taken in, maximum over all steps: 1 for whole steps. There are "
          "more where it was cut at impacts, or links turn farther than MuJoCo's integrators "
          "follow.")
      .def("__eq__",
           [](const StepStats& stats, const py::object& other) {
             return py::isinstance<StepStats>(other) &&
                    values(stats).equal(values(other.cast<const StepStats&>()));
           })
      .def("__hash__", [](const StepStats& s) { return py::hash(values(s)); })
      .def(py::pickle([](const StepStats& s) { return values(s); },
                      [](const py::tuple& state) {
                        if (state.size() != 9) throw std::invalid_argument("StepStats: bad pickle");
                        return StepStats{
                            state[0].cast<int>(),    state[1].cast<int>(), state[2].cast<int>(),
                            state[3].cast<int>(),    state[4].cast<int>(), state[5].cast<double>(),
                            state[6].cast<double>(), state[7].cast<int>(), state[8].cast<int>()};
                      }))
      .def("__repr__", [](const StepStats& s) {
        return py::str(
                   "StepStats(contacts={}, touching={}, islands={}, microsteps={}, clipped={}, "
                   "max_penetration={}, max_compression={}, cuts={}, parts={})")
            .format(s.contacts, s.touching, s.islands, s.microsteps, s.clipped, s.max_penetration,
                    s.max_compression, s.cuts, s.parts);
      });

  py::class_<ModelLock, std::shared_ptr<ModelLock>>(
      module, "ModelLock", "Held, as a context manager, while a model is stepped or copied.")
      .def(py::init<>())
      .def("lock_with_line", &ModelLock::lock_with_line, py::call_guard<WithoutGil>())
      .def("unlock_with_line", &ModelLock::unlock_with_line)
      .def("__enter__", &ModelLock::lock, py::call_guard<WithoutGil>())
      .def("__exit__", [](ModelLock& lock, const py::object&, const py::object&,
                          const py::object&) { lock.unlock(); });

  module.attr("MAX_THREADS") = kMostThreads;

  py::class_<SharedStepper>(module, "Stepper", "Steps one model; see dashpot.Engine.")
      .def(py::init<std::uintptr_t, std::shared_ptr<ModelLock>, const Parameters&, int>(),
           py::arg("model_address"), py::arg("lock"), py::arg("parameters"), py::arg("nthread"))
      .def("step", &SharedStepper::step, py::arg("data_address"), py::arg("nstep"));

  module.def(
      "reserve_memory",
      [](std::uintptr_t model) {
        mjModel_* m = model_at(model);
        host::join_coupled_trees(m);
        const int capacity = host::contact_capacity(m);
        host::reserve_memory(m, memory_layout(m, capacity).size());
        return capacity;
      },
      py::arg("model_address"),
      "Enlarges nuserdata of a model by the size of contact memory, and joins the kinematic trees "
      "that a single constraint row couples by more than two. Returns for how many contacts the "
      "memory is.");
  module.def(
      "have_same_sizes",
      [](std::uintptr_t model, std::uintptr_t other) {
        return host::have_same_sizes(model_at(model), model_at(other));
      },
      py::arg("model_address"), py::arg("other_address"));
  module.def("contacts", &contacts_dict, py::arg("model_address"), py::arg("data_address"),
             py::arg("contact_capacity"));
  module.def("energy", &energy_dict, py::arg("model_address"), py::arg("data_address"),
             py::arg("scratch_address"), py::arg("contact_capacity"));
  module.def(
      "features",
      [](std::uintptr_t model, Law law) {
        py::list result;
        for (const host::Feature& f : host::features(model_at(model), law)) {
          static const char* const kNames[] = {"honoured", "mapped", "refused"};
          result.append(py::make_tuple(f.name, kNames[static_cast<int>(f.treatment)], f.note));
        }
        return result;
      },
      py::arg("model_address"), py::arg("law"));
  module.def(
      "check_supported",
      [](std::uintptr_t model, const Options& options) {
        host::check_supported(model_at(model), options);
      },
      py::arg("model_address"), py::arg("options"));
}

}  // namespace dashpot::bindings
