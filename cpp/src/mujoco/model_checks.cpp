#include "dashpot/mujoco/model_checks.hpp"

#include <mujoco/mujoco.h>

#include <cmath>
#include <stdexcept>
#include <string>

#include "dashpot/mujoco/model_numbers.hpp"
#include "dashpot/mujoco/names.hpp"
#include "dashpot/mujoco/simple_inertia.hpp"

namespace dashpot::host {

namespace {

// MuJoCo stops the process, or writes beyond its rows, at others.
void check_condim(const mjModel* m, const char* field, int type, const int* condim, mjtSize count) {
  for (int i = 0; i < count; ++i)
    if (condim[i] != 1 && condim[i] != 3 && condim[i] != 4 && condim[i] != 6)
      throw std::invalid_argument("model." + std::string(field) + " of " + named(m, type, i) +
                                  " is " + std::to_string(condim[i]) + "; it must be 1, 3, 4 or 6");
}

void check_condim(const mjModel* m) {
  check_condim(m, "geom_condim", mjOBJ_GEOM, m->geom_condim, m->ngeom);
  check_condim(m, "pair_dim", mjOBJ_PAIR, m->pair_dim, m->npair);
  check_condim(m, "flex_condim", mjOBJ_FLEX, m->flex_condim, m->nflex);
}

// Types that collide need what they are made of: MuJoCo reads it unasked.
void check_geom_types(const mjModel* m) {
  for (int geom = 0; geom < m->ngeom; ++geom) {
    const int type = m->geom_type[geom];
    const bool of_field = type == mjGEOM_HFIELD, of_mesh = type == mjGEOM_MESH;
    const mjtSize most = of_field ? m->nhfield : of_mesh ? m->nmesh : 0;
    if (type < 0 || type >= mjNGEOMTYPES)
      throw std::invalid_argument("model.geom_type of geom " + named(m, mjOBJ_GEOM, geom) + " is " +
                                  std::to_string(type) + ", which is no type of geoms");
    if (type == mjGEOM_SDF && m->geom_plugin[geom] < 0 && m->geom_dataid[geom] < 0)
      throw std::invalid_argument("model.geom_type of geom " + named(m, mjOBJ_GEOM, geom) +
                                  " is sdf, but it has neither a plugin nor a mesh");
    if ((of_field || of_mesh) && (m->geom_dataid[geom] < 0 || m->geom_dataid[geom] >= most))
      throw std::invalid_argument("model.geom_dataid of geom " + named(m, mjOBJ_GEOM, geom) +
                                  " is " + std::to_string(m->geom_dataid[geom]) + "; a " +
                                  (of_field ? "height field" : "mesh") + " must be one of " +
                                  std::to_string(most));
  }
}

void check_option(const char* field, const mjtNum* values, int count) {
  for (int i = 0; i < count; ++i)
    if (!std::isfinite(values[i]))
      throw std::invalid_argument("model.opt." + std::string(field) + " holds " +
                                  std::to_string(values[i]) + "; it must be finite");
}

void check_time_and_medium(const mjOption& o) {
  if (!(std::isfinite(o.timestep) && o.timestep > 0.0))
    throw std::invalid_argument("model.opt.timestep is " + std::to_string(o.timestep) +
                                "; it must be finite and > 0 s");
  check_option("gravity", o.gravity, 3);
  check_option("wind", o.wind, 3);
  check_option("magnetic", o.magnetic, 3);
  check_option("density", &o.density, 1);
  check_option("viscosity", &o.viscosity, 1);
}

}  // namespace

void check_values(const mjModel_* m) {
  check_time_and_medium(m->opt);
  check_condim(m);
  check_geom_types(m);
  check_numbers(m);
  check_masses(m);
}

void check_heights(const mjModel_* m) {
  for (int field = 0; field < m->nhfield; ++field) {
    const int columns = m->hfield_ncol[field], count = m->hfield_nrow[field] * columns;
    const float* const heights = m->hfield_data + m->hfield_adr[field];
    for (int i = 0; i < count; ++i)
      if (!std::isfinite(heights[i]))
        throw std::invalid_argument("model.hfield_data of hfield " + named(m, mjOBJ_HFIELD, field) +
                                    " holds " + std::to_string(heights[i]) + " in row " +
                                    std::to_string(i / columns) + ", column " +
                                    std::to_string(i % columns) + "; heights must be finite");
  }
}

}  // namespace dashpot::host
