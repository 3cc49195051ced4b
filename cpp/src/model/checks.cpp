#include "dashpot/model/checks.hpp"

#include <mujoco/mjxmacro.h>
#include <mujoco/mujoco.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

#include "dashpot/law/text.hpp"
#include "dashpot/model/body_inertia.hpp"
#include "dashpot/model/errors.hpp"
#include "dashpot/model/state.hpp"

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

struct Bytes {
  const char *begin, *end;
};

Bytes bytes(const void* begin, const void* end) {
  return {static_cast<const char*>(begin), static_cast<const char*>(end)};
}

// The arrays of a model lie in its buffer in the order of their declaration.
std::array<Bytes, 4> ranges_of(const mjModel* m) {
  return {bytes(&m->opt, &m->opt + 1), bytes(m->qpos0, m->bvh_depth),
          bytes(m->jnt_type, m->mesh_vertadr), bytes(m->pair_dim, m->name_bodyadr)};
}

void check_finite(const std::string& field, double value) {
  if (!std::isfinite(value))
    throw std::invalid_argument("data." + field + " is " + text(value) + "; it must be finite");
}

void check_finite(const char* field, const mjtNum* values, mjtSize count) {
  if (are_finite(values, count)) return;
  for (mjtSize i = 0; i < count; ++i)
    if (!std::isfinite(values[i]))
      check_finite(std::string(field) + "[" + std::to_string(i) + "]", values[i]);
}

// What MuJoCo calls a bad state (mj_checkPos, mj_checkVel).
void check_state(const char* field, const mjtNum* values, mjtSize count) {
  if (are_within(values, count, kLargestValue)) return;
  check_finite(field, values, count);
  const mjtNum* const at = std::find_if(
      values, values + count, [](mjtNum value) { return std::abs(value) > kLargestValue; });
  throw std::invalid_argument("data." + std::string(field) + "[" + std::to_string(at - values) +
                              "] is " + text(*at) + "; it must be at most 1e10 in size");
}

}  // namespace

static_assert(kLargestValue == mjMAXVAL);

long long data_size(const mjModel_* m) { return make_data(m)->nbuffer; }

bool have_same_sizes(const mjModel_* a, const mjModel_* b) {
#define X(size) \
  if (a->size != b->size) return false;
  MJMODEL_SIZES
#undef X
  return true;
}

void check_data(const mjModel_* m, const mjData_* d, long long data_size) {
  const bool both_signed = d->signature != 0 && m->signature != 0;
  if ((both_signed && d->signature != m->signature) || d->nbuffer != data_size)
    throw std::invalid_argument(
        "data was made from another model; make it with Engine.make_data()");
  if (!std::isfinite(d->time)) check_finite("time", d->time);
  check_state("qpos", d->qpos, m->nq);
  check_state("qvel", d->qvel, m->nv);
  check_finite("act", d->act, m->na);
  check_finite("ctrl", d->ctrl, m->nu);
  check_finite("qfrc_applied", d->qfrc_applied, m->nv);
  const bool forces_are_finite = are_finite(d->xfrc_applied, 6 * m->nbody);
  for (int i = 0; i < 6 * m->nbody && !forces_are_finite; ++i)
    if (!std::isfinite(d->xfrc_applied[i]))
      check_finite("xfrc_applied[" + std::to_string(i / 6) + ", " + std::to_string(i % 6) +
                       "] (body " + named(m, mjOBJ_BODY, i / 6) + ")",
                   d->xfrc_applied[i]);
  check_finite("mocap_pos", d->mocap_pos, 3 * m->nmocap);
  check_finite("mocap_quat", d->mocap_quat, 4 * m->nmocap);
}

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

bool KeptModel::is_same(const mjModel_* m) const {
  if (copy_.empty()) return false;
  const char* kept = copy_.data();
  for (const Bytes& range : ranges_of(m)) {
    const size_t size = range.end - range.begin;
    if (std::memcmp(kept, range.begin, size) != 0) return false;
    kept += size;
  }
  return true;
}

void KeptModel::keep(const mjModel_* m) {
  copy_.clear();
  for (const Bytes& range : ranges_of(m)) copy_.insert(copy_.end(), range.begin, range.end);
}

}  // namespace dashpot::host
