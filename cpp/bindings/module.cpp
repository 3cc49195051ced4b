// The extension module dashpot._core: a table of contents.

#include <pybind11/pybind11.h>

#include "without_gil.hpp"

namespace dashpot::bindings {
void bind_law(pybind11::module_& module);
void bind_engine(pybind11::module_& module);
void bind_contact_material(pybind11::module_& module);
void bind_query(pybind11::module_& module);
void bind_rollout(pybind11::module_& module);
void bind_recordings(pybind11::module_& module);
}  // namespace dashpot::bindings

PYBIND11_MODULE(_core, module) {
  using namespace dashpot::bindings;
  module.doc() = "C++ core of dashpot: contact law, engine, rollouts, queries.";
  module.attr("__version__") = DASHPOT_VERSION;
  module.attr("__mujoco_version__") = DASHPOT_MUJOCO_VERSION;
  module.attr("__mujoco_headers__") = DASHPOT_MUJOCO_HEADERS;
  module.def(
      "built_by", [] { return DASHPOT_BUILT_BY; },
      "Compiler with its version, type of build, and IPO where it optimised across files.");
  pybind11::module_::import("atexit").attr("register")(pybind11::cpp_function(&stop_at_exit));
  bind_law(module);
  bind_engine(module);
  bind_contact_material(module);
  bind_query(module);
  bind_rollout(module);
  bind_recordings(module);
}
