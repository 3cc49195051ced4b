// What contacts between two geoms have; see dashpot.ContactMaterial.

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <limits>
#include <optional>

#include "dashpot/islands/group_material.hpp"
#include "dashpot/model/contacts.hpp"

namespace py = pybind11;

namespace dashpot::bindings {

namespace {

// Damping ratio and, on top of it, damping in N s/m.
struct Damping {
  double ratio = 0.0, absolute = 0.0;
};

Damping damping_of_pair(const GroupMaterial& given) {
  if (given.from_solref) return {given.damping_ratio(), 0.0};
  const Material& material = given.material;
  switch (material.form) {
    case DampingForm::kDamping:
      return {0.0, material.damping};
    case DampingForm::kRestitution:
      return {restitution_to_damping_ratio(material.damping), 0.0};
    default:
      return {material.damping, material.added_damping};
  }
}

// None where restitution depends on the mass, or is that of rigid contacts together.
std::optional<double> restitution_of_pair(const GroupMaterial& given, const Damping& damping) {
  const bool of_restitution = given.material.form == DampingForm::kRestitution;
  if (!given.from_solref && of_restitution) return given.material.damping;
  if (damping.absolute > 0.0 || given.is_rigid()) return std::nullopt;
  return damping_ratio_to_restitution(damping.ratio);
}

py::dict contact_material(std::uintptr_t address, const Parameters& parameters, int geom1,
                          int geom2) {
  const auto* model = reinterpret_cast<const mjModel_*>(address);
  const ContactInput input = host::contact_of_pair(model, geom1, geom2);
  // The stiffness of a solref depends on the load; its damping ratio does not.
  const GroupMaterial given =
      material_of(model, parameters, input, std::numeric_limits<double>::infinity());
  const Damping damping = damping_of_pair(given);
  const auto tuple = [](const auto& numbers) { return py::tuple(py::cast(numbers)); };
  py::dict result;
  result["of_solref"] = given.from_solref;
  result["stiffness"] =
      given.has_si_stiffness() ? std::optional(given.material.stiffness) : std::nullopt;
  result["damping"] = damping.absolute;
  result["damping_ratio"] = damping.ratio;
  result["restitution"] = restitution_of_pair(given, damping);
  result["friction"] = tuple(friction_of(input, given.material));
  result["condim"] = input.dim;
  result["loaded_friction"] = given.material.loaded_friction;
  result["friction_load"] = given.material.friction_load;
  result["tangential_ratio"] = given.material.tangential_ratio;
  result["tangential_damping_ratio"] = given.material.tangential_damping_ratio;
  result["solref"] = tuple(input.solref);
  result["solimp"] = tuple(input.solimp);
  return result;
}

}  // namespace

void bind_contact_material(py::module_& module) {
  module.def("contact_material", &contact_material, py::arg("model_address"), py::arg("parameters"),
             py::arg("geom1"), py::arg("geom2"));
}

}  // namespace dashpot::bindings
