#include "dashpot/mujoco/data_checks.hpp"

#include <mujoco/mjxmacro.h>
#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "dashpot/law/text.hpp"
#include "dashpot/mujoco/finite.hpp"
#include "dashpot/mujoco/names.hpp"
#include "dashpot/mujoco/owned.hpp"

namespace dashpot::host {

static_assert(kLargestValue == mjMAXVAL);

namespace {

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

}  // namespace dashpot::host
