#include "dashpot/mujoco/kept_model.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <array>
#include <cstring>

namespace dashpot::host {

namespace {

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

}  // namespace

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
