// Binds the law rooms (kelvin_voigt, friction, material) over one-dimensional arrays of equal
// length; dashpot.law and dashpot.materials check values and broadcast before they call these.

#include <pybind11/native_enum.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <initializer_list>
#include <stdexcept>

#include "dashpot/law/friction.hpp"
#include "dashpot/law/kelvin_voigt.hpp"
#include "dashpot/law/material.hpp"
#include "dashpot/law/solref.hpp"

namespace py = pybind11;

namespace dashpot::bindings {
namespace {

using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;

py::ssize_t common_length(std::initializer_list<const Array*> arrays) {
  const py::ssize_t length = (*arrays.begin())->size();
  for (const Array* array : arrays) {
    if (array->ndim() != 1 || array->size() != length) {
      throw std::invalid_argument("the law takes one-dimensional arrays of equal length");
    }
  }
  return length;
}

KelvinVoigt contact_at(const Array& stiffness, const Array& damping, const Array& inverse_mass,
                       py::ssize_t i) {
  return {stiffness.data()[i], damping.data()[i], inverse_mass.data()[i]};
}

py::tuple propagate_all(const Array& stiffness, const Array& damping, const Array& inverse_mass,
                        const Array& time) {
  const py::ssize_t n = common_length({&stiffness, &damping, &inverse_mass, &time});
  std::array<Array, 5> e{Array(n), Array(n), Array(n), Array(n), Array(n)};
  for (py::ssize_t i = 0; i < n; ++i) {
    const Propagator p = propagate(contact_at(stiffness, damping, inverse_mass, i), time.data()[i]);
    const double values[5] = {p.e0, p.e1, p.e2, p.e3, p.e4};
    for (int j = 0; j < 5; ++j) e[j].mutable_data()[i] = values[j];
  }
  return py::make_tuple(e[0], e[1], e[2], e[3], e[4]);
}

using FlowFunction = Flow (*)(const KelvinVoigt&, double, double, double, double,
                              const Propagator*);

py::tuple flow_all(FlowFunction flow, const Array& stiffness, const Array& damping,
                   const Array& inverse_mass, const Array& gap, const Array& rate,
                   const Array& load, const Array& time) {
  const py::ssize_t n =
      common_length({&stiffness, &damping, &inverse_mass, &gap, &rate, &load, &time});
  Array impulse(n), moment(n), end_gap(n), end_rate(n), force(n);
  py::array_t<bool> touched(n);
  py::array_t<int> events(n);
  for (py::ssize_t i = 0; i < n; ++i) {
    const Flow f = flow(contact_at(stiffness, damping, inverse_mass, i), gap.data()[i],
                        rate.data()[i], load.data()[i], time.data()[i], nullptr);
    impulse.mutable_data()[i] = f.impulse;
    moment.mutable_data()[i] = f.moment;
    end_gap.mutable_data()[i] = f.gap;
    end_rate.mutable_data()[i] = f.rate;
    force.mutable_data()[i] = f.force;
    touched.mutable_data()[i] = f.touched;
    events.mutable_data()[i] = f.events;
  }
  return py::make_tuple(impulse, moment, end_gap, end_rate, force, touched, events);
}

Array radial_return_all(const Array& impulse, const Array& mu, const Array& normal_impulse) {
  if (impulse.ndim() != 2 || mu.ndim() != 2 || normal_impulse.ndim() != 1 ||
      mu.shape(0) != impulse.shape(0) || mu.shape(1) != impulse.shape(1) ||
      normal_impulse.shape(0) != impulse.shape(0) || impulse.shape(1) > kMaxFrictionDirections) {
    throw std::invalid_argument(
        "radial_return takes impulse (n, m), mu (n, m), normal_impulse (n)");
  }
  const py::ssize_t n = impulse.shape(0), directions = impulse.shape(1);
  Array factor(n);
  for (py::ssize_t i = 0; i < n; ++i) {
    factor.mutable_data()[i] =
        radial_return(impulse.data() + i * directions, mu.data() + i * directions,
                      static_cast<int>(directions), normal_impulse.data()[i]);
  }
  return factor;
}

py::tuple return_to_limit_all(const Array& impulse, const Array& mu, const Array& response,
                              const Array& normal_impulse) {
  const bool matrices = impulse.ndim() == 2 && mu.ndim() == 2 && response.ndim() == 2;
  if (!matrices || normal_impulse.ndim() != 1 || mu.shape(0) != impulse.shape(0) ||
      mu.shape(1) != impulse.shape(1) || response.shape(0) != impulse.shape(0) ||
      response.shape(1) != impulse.shape(1) || normal_impulse.shape(0) != impulse.shape(0) ||
      impulse.shape(1) > kMaxFrictionDirections) {
    throw std::invalid_argument(
        "return_to_limit takes impulse (n, m), mu (n, m), response (n, m), normal_impulse (n)");
  }
  const py::ssize_t n = impulse.shape(0), directions = impulse.shape(1);
  Array returned({n, directions});
  std::copy_n(impulse.data(), n * directions, returned.mutable_data());
  py::array_t<bool> sticks(n);
  for (py::ssize_t i = 0; i < n; ++i) {
    sticks.mutable_data()[i] = return_to_limit(
        returned.mutable_data() + i * directions, mu.data() + i * directions,
        response.data() + i * directions, static_cast<int>(directions), normal_impulse.data()[i]);
  }
  return py::make_tuple(returned, sticks);
}

}  // namespace

void bind_law(py::module_& module) {
  module.def("propagate", &propagate_all, py::arg("stiffness"), py::arg("damping"),
             py::arg("inverse_mass"), py::arg("time"), "E0..E4; see dashpot.law.propagate.");
  module.def(
      "flow_contact",
      [](const Array& stiffness, const Array& damping, const Array& inverse_mass, const Array& gap,
         const Array& rate, const Array& load, const Array& time) {
        return flow_all(&flow_contact, stiffness, damping, inverse_mass, gap, rate, load, time);
      },
      py::arg("stiffness"), py::arg("damping"), py::arg("inverse_mass"), py::arg("gap"),
      py::arg("rate"), py::arg("load"), py::arg("time"),
      "Unilateral contact; see dashpot.law.flow_contact.");
  module.def(
      "flow_spring",
      [](const Array& stiffness, const Array& damping, const Array& inverse_mass,
         const Array& displacement, const Array& rate, const Array& load, const Array& time) {
        return flow_all(&flow_spring, stiffness, damping, inverse_mass, displacement, rate, load,
                        time);
      },
      py::arg("stiffness"), py::arg("damping"), py::arg("inverse_mass"), py::arg("displacement"),
      py::arg("rate"), py::arg("load"), py::arg("time"),
      "Bilateral spring-damper; see dashpot.law.flow_spring.");
  module.def("radial_return", &radial_return_all, py::arg("impulse"), py::arg("mu"),
             py::arg("normal_impulse"), "Factor in [0, 1]; see dashpot.law.radial_return.");
  module.def("return_to_limit", &return_to_limit_all, py::arg("impulse"), py::arg("mu"),
             py::arg("response"), py::arg("normal_impulse"),
             "Impulses (n, m) and whether they stick (n); see dashpot.law.return_to_limit.");
  module.def("damping_ratio_to_restitution", py::vectorize(&damping_ratio_to_restitution),
             py::arg("damping_ratio"), "See dashpot.law.damping_ratio_to_restitution.");
  module.def("restitution_to_damping_ratio", py::vectorize(&restitution_to_damping_ratio),
             py::arg("restitution"), "See dashpot.law.restitution_to_damping_ratio.");
  module.def("solref_to_spring", &solref_to_spring, py::arg("ref0"), py::arg("ref1"),
             py::arg("impedance_width"), "See dashpot.law.solref_to_spring.");
  module.def(
      "solref_to_spring_at_rest",
      [](const std::array<double, 2>& solref, const std::array<double, 5>& solimp, double load) {
        return solref_to_spring_at_rest(solref, solimp, load);
      },
      py::arg("solref"), py::arg("solimp"), py::arg("load"),
      "See dashpot.law.solref_to_spring_at_rest.");

  py::native_enum<DampingForm>(module, "DampingForm", "enum.Enum",
                               "How the damping of a material is given.")
      .value("ratio", DampingForm::kRatio)
      .value("damping", DampingForm::kDamping)
      .value("restitution", DampingForm::kRestitution)
      .finalize();
  py::native_enum<StiffnessRule>(module, "StiffnessRule", "enum.Enum",
                                 "How two stiffnesses combine.")
      .value("series", StiffnessRule::kSeries)
      .value("min", StiffnessRule::kMin)
      .value("max", StiffnessRule::kMax)
      .value("mean", StiffnessRule::kMean)
      .finalize();
  py::native_enum<DampingRule>(module, "DampingRule", "enum.Enum", "How two dampings combine.")
      .value("series", DampingRule::kSeries)
      .value("min", DampingRule::kMin)
      .value("max", DampingRule::kMax)
      .value("mean", DampingRule::kMean)
      .finalize();
  py::native_enum<FrictionRule>(module, "FrictionRule", "enum.Enum",
                                "How two friction coefficients combine.")
      .value("max", FrictionRule::kMax)
      .value("min", FrictionRule::kMin)
      .value("mean", FrictionRule::kMean)
      .value("geometric_mean", FrictionRule::kGeometricMean)
      .finalize();

  py::class_<Material>(module, "Material", "Core form of dashpot.Material, in SI units.")
      .def(py::init<>())
      .def_readwrite("from_model", &Material::from_model)
      .def_readwrite("rigid", &Material::rigid)
      .def_readwrite("stiffness", &Material::stiffness)
      .def_readwrite("form", &Material::form)
      .def_readwrite("damping", &Material::damping)
      .def_readwrite("added_damping", &Material::added_damping)
      .def_readwrite("has_friction", &Material::has_friction)
      .def_readwrite("friction", &Material::friction)
      .def_readwrite("loaded_friction", &Material::loaded_friction)
      .def_readwrite("friction_load", &Material::friction_load)
      .def_readwrite("tangential_ratio", &Material::tangential_ratio)
      .def_readwrite("tangential_damping_ratio", &Material::tangential_damping_ratio);
  py::class_<CombinationRules>(module, "CombinationRules", "Core form of dashpot.CombinationRules.")
      .def(py::init<>())
      .def_readwrite("stiffness", &CombinationRules::stiffness)
      .def_readwrite("damping", &CombinationRules::damping)
      .def_readwrite("friction", &CombinationRules::friction);
  module.def("combine", &combine, py::arg("a"), py::arg("b"), py::arg("rules"),
             "Combines two materials; equations at the top of material.cpp.");
  module.def(
      "damping_of", &damping_of, py::arg("material"), py::arg("stiffness"), py::arg("inverse_mass"),
      "Damping (N s/m) of a material at a stiffness (N/m) and apparent inverse mass (1/kg).");
}

}  // namespace dashpot::bindings
