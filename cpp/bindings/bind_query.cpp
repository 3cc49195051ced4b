// Signed distance and time of impact between geoms of a model.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <algorithm>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include "dashpot/detect/geometry_host.hpp"
#include "dashpot/geometry/query.hpp"
#include "dashpot/simulations/distances.hpp"
#include "without_gil.hpp"

namespace py = pybind11;

namespace dashpot::bindings {

namespace {

const mjModel_* model_at(std::uintptr_t address) {
  return reinterpret_cast<const mjModel_*>(address);
}

const mjData_* data_at(std::uintptr_t address) { return reinterpret_cast<const mjData_*>(address); }

py::tuple to_tuple(const Eigen::Vector3d& v) { return py::make_tuple(v.x(), v.y(), v.z()); }

py::tuple to_tuple(const Distance& d) {
  return py::make_tuple(d.distance, to_tuple(d.point1), to_tuple(d.point2), to_tuple(d.normal));
}

py::tuple distance_now(std::uintptr_t model_address, std::uintptr_t data_address, int geom1,
                       int geom2) {
  Distance result;
  {
    const WithoutGil without_gil;
    result = geom_distance(model_at(model_address), data_at(data_address), geom1, geom2);
  }
  return to_tuple(result);
}

using Array = py::array_t<double, py::array::c_style | py::array::forcecast>;

// Signed distances as arrays (distance, point1, point2, normal).
template <typename DistanceAt>
py::tuple to_arrays(py::ssize_t n, const DistanceAt& at) {
  Array value(n), point1({n, py::ssize_t(3)}), point2({n, py::ssize_t(3)}),
      normal({n, py::ssize_t(3)});
  for (py::ssize_t i = 0; i < n; ++i) {
    const Distance& found = at(i);
    value.mutable_at(i) = found.distance;
    std::copy_n(found.point1.data(), 3, point1.mutable_data(i));
    std::copy_n(found.point2.data(), 3, point2.mutable_data(i));
    std::copy_n(found.normal.data(), 3, normal.mutable_data(i));
  }
  return py::make_tuple(value, point1, point2, normal);
}

py::tuple distances_at(std::uintptr_t model_address, int geom1, int geom2, const Array& qpos,
                       int nthread) {
  if (qpos.ndim() != 2) throw std::invalid_argument("qpos must be 2-D");
  const py::ssize_t n = qpos.shape(0);
  std::vector<Distance> found;
  {
    const WithoutGil without_gil;
    found = geom_distances(model_at(model_address), geom1, geom2, qpos.data(), static_cast<int>(n),
                           nthread, handle_signals);
  }
  return to_arrays(n, [&](py::ssize_t i) -> const Distance& { return found[i]; });
}

py::tuple times_of_impact_at(std::uintptr_t model_address, int geom1, int geom2, const Array& qpos,
                             const Array& qvel, double horizon, int nthread) {
  if (qpos.ndim() != 2 || qvel.ndim() != 2) throw std::invalid_argument("qpos, qvel must be 2-D");
  const py::ssize_t n = qpos.shape(0);
  if (qvel.shape(0) != n) throw std::invalid_argument("qpos and qvel differ in length");
  std::vector<TimeOfImpact> found;
  {
    const WithoutGil without_gil;
    found = geom_times_of_impact(model_at(model_address), geom1, geom2, qpos.data(), qvel.data(),
                                 static_cast<int>(n), horizon, nthread, handle_signals);
  }
  py::array_t<bool> hit(n);
  Array time(n);
  for (py::ssize_t i = 0; i < n; ++i) {
    hit.mutable_at(i) = found[i].hit;
    time.mutable_at(i) = found[i].time;
  }
  return py::make_tuple(
      hit, time, to_arrays(n, [&](py::ssize_t i) -> const Distance& { return found[i].at; }));
}

py::tuple time_of_impact_now(std::uintptr_t model_address, std::uintptr_t data_address, int geom1,
                             int geom2, double horizon) {
  TimeOfImpact result;
  {
    const WithoutGil without_gil;
    result =
        geom_time_of_impact(model_at(model_address), data_at(data_address), geom1, geom2, horizon);
  }
  return py::make_tuple(result.hit, result.time, to_tuple(result.at), result.evaluations);
}

py::list close_geoms(std::uintptr_t model_address, std::uintptr_t data_address, int body,
                     double radius) {
  std::vector<ClosePair> pairs;
  {
    const WithoutGil without_gil;
    const auto* model = model_at(model_address);
    const auto* data = data_at(data_address);
    pairs = closest_pairs(placed_shapes(model, data, body), radius);
  }
  py::list result;
  for (const ClosePair& pair : pairs) {
    result.append(py::make_tuple(pair.geom1, pair.geom2, to_tuple(pair.distance)));
  }
  return result;
}

}  // namespace

void bind_query(py::module_& module) {
  module.def("geom_distance", &distance_now, py::arg("model_address"), py::arg("data_address"),
             py::arg("geom1"), py::arg("geom2"),
             "Signed distance of two geoms as (distance, point1, point2, normal). The addresses "
             "are those of a live MjModel and MjData; geom ids in range.");
  module.def("geom_distances", &distances_at, py::arg("model_address"), py::arg("geom1"),
             py::arg("geom2"), py::arg("qpos"), py::arg("nthread"),
             "Signed distances at configurations qpos (n, nq) as arrays (distance, point1, point2, "
             "normal), GIL released.");
  module.def("geom_time_of_impact", &time_of_impact_now, py::arg("model_address"),
             py::arg("data_address"), py::arg("geom1"), py::arg("geom2"), py::arg("horizon"),
             "First contact of two geoms along their present velocities as (hit, time, distance "
             "tuple, distances computed).");
  module.def(
      "geom_times_of_impact", &times_of_impact_at, py::arg("model_address"), py::arg("geom1"),
      py::arg("geom2"), py::arg("qpos"), py::arg("qvel"), py::arg("horizon"), py::arg("nthread"),
      "First contacts for states qpos (n, nq), qvel (n, nv) as arrays (hit, time, (distance, "
      "point1, point2, normal)), GIL released.");
  module.def("close_geoms", &close_geoms, py::arg("model_address"), py::arg("data_address"),
             py::arg("body"), py::arg("radius"),
             "Pairs of geoms within a radius as [(geom1, geom2, distance tuple)], nearest first; "
             "body -1 for all.");
}

}  // namespace dashpot::bindings
