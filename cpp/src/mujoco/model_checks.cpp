#include "dashpot/mujoco/model_checks.hpp"

#include <mujoco/mujoco.h>

#include <cmath>
#include <stdexcept>
#include <string>

#include "dashpot/mujoco/finite.hpp"
#include "dashpot/mujoco/names.hpp"
#include "dashpot/mujoco/simple_inertia.hpp"

namespace dashpot::host {

namespace {

// `each` coefficients for each of `count` objects.
void check_friction(const mjModel* m, const char* kind, int type, const mjtNum* friction,
                    mjtSize count, int each) {
  if (are_finite_and_not_negative(friction, each * count)) return;
  for (int i = 0; i < each * count; ++i)
    if (!(std::isfinite(friction[i]) && friction[i] >= 0.0))
      throw std::invalid_argument("model." + std::string(kind) + "_friction of " + kind + " " +
                                  named(m, type, i / each) + " holds " +
                                  std::to_string(friction[i]) + "; it must be finite and >= 0");
}

void check_sizes(const mjModel* m) {
  if (are_finite_and_not_negative(m->geom_size, 3 * m->ngeom)) return;
  for (int i = 0; i < 3 * m->ngeom; ++i)
    if (!(std::isfinite(m->geom_size[i]) && m->geom_size[i] >= 0.0))
      throw std::invalid_argument("model.geom_size of geom " + named(m, mjOBJ_GEOM, i / 3) +
                                  " holds " + std::to_string(m->geom_size[i]) +
                                  "; it must be finite and >= 0");
}

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

void check_friction(const mjModel* m) {
  check_friction(m, "geom", mjOBJ_GEOM, m->geom_friction, m->ngeom, 3);
  check_friction(m, "pair", mjOBJ_PAIR, m->pair_friction, m->npair, 5);
  check_friction(m, "flex", mjOBJ_FLEX, m->flex_friction, m->nflex, 3);
}

// Of what is stepped with as it is: not a number, or infinite where that is `allowed`.
bool is_bad(mjtNum value, bool infinite_allowed) {
  return infinite_allowed ? std::isnan(value) : !std::isfinite(value);
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

// `each` numbers for each of `count` objects.
void check_finite(const mjModel* m, const char* field, const char* kind, int type,
                  const mjtNum* values, mjtSize count, int each, bool infinite_allowed = false) {
  if (are_finite(values, each * count)) return;
  for (mjtSize i = 0; i < each * count; ++i)
    if (is_bad(values[i], infinite_allowed))
      throw std::invalid_argument("model." + std::string(field) + " of " + kind + " " +
                                  named(m, type, static_cast<int>(i / each)) + " holds " +
                                  std::to_string(values[i]) + "; it must be " +
                                  (infinite_allowed ? "a number" : "finite"));
}

void check_poses(const mjModel* m) {
  check_finite(m, "body_pos", "body", mjOBJ_BODY, m->body_pos, m->nbody, 3);
  check_finite(m, "body_quat", "body", mjOBJ_BODY, m->body_quat, m->nbody, 4);
  check_finite(m, "body_ipos", "body", mjOBJ_BODY, m->body_ipos, m->nbody, 3);
  check_finite(m, "body_iquat", "body", mjOBJ_BODY, m->body_iquat, m->nbody, 4);
  check_finite(m, "jnt_pos", "joint", mjOBJ_JOINT, m->jnt_pos, m->njnt, 3);
  check_finite(m, "jnt_axis", "joint", mjOBJ_JOINT, m->jnt_axis, m->njnt, 3);
  check_finite(m, "geom_pos", "geom", mjOBJ_GEOM, m->geom_pos, m->ngeom, 3);
  check_finite(m, "geom_quat", "geom", mjOBJ_GEOM, m->geom_quat, m->ngeom, 4);
}

void check_constraints(const mjModel* m) {
  check_finite(m, "eq_data", "equality", mjOBJ_EQUALITY, m->eq_data, m->neq, mjNEQDATA);
  check_finite(m, "jnt_range", "joint", mjOBJ_JOINT, m->jnt_range, m->njnt, 2, true);
  check_finite(m, "tendon_range", "tendon", mjOBJ_TENDON, m->tendon_range, m->ntendon, 2, true);
}

// A number for each degree of freedom, named by its joint.
void check_of_dofs(const mjModel* m, const char* field, const mjtNum* values,
                   bool negative_allowed) {
  const bool fine =
      negative_allowed ? are_finite(values, m->nv) : are_finite_and_not_negative(values, m->nv);
  for (int i = 0; i < m->nv && !fine; ++i)
    if (!std::isfinite(values[i]) || (values[i] < 0.0 && !negative_allowed))
      throw std::invalid_argument("model." + std::string(field) + " of joint " +
                                  named(m, mjOBJ_JOINT, m->dof_jntid[i]) + " holds " +
                                  std::to_string(values[i]) + "; it must be finite" +
                                  (negative_allowed ? "" : " and >= 0"));
}

void check_joints(const mjModel* m) {
  check_of_dofs(m, "dof_armature", m->dof_armature, false);
  check_of_dofs(m, "dof_damping", m->dof_damping, true);
  check_of_dofs(m, "dof_frictionloss", m->dof_frictionloss, true);
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
  check_friction(m);
  check_condim(m);
  check_masses(m);
  check_sizes(m);
  check_geom_types(m);
  check_time_and_medium(m->opt);
  check_poses(m);
  check_constraints(m);
  check_joints(m);
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
