#include "dashpot/mujoco/terrain_distances.hpp"

#include <mujoco/mujoco.h>

namespace dashpot::host {

int mend_terrain_distances([[maybe_unused]] const mjData_* d, [[maybe_unused]] int terrain,
                           [[maybe_unused]] double margin, [[maybe_unused]] mjPreContact_* contact,
                           int count) {
#if mjVERSION_HEADER < 3016000
  const mjtNum* rotation = d->geom_xmat + 9 * terrain;
  int kept = 0;
  for (int i = 0; i < count; ++i) {
    mjPreContact_ mended = contact[i];
    mjtNum normal[3];
    mju_mulMatTVec3(normal, rotation, mended.normal);
    mended.dist += 1.5 * margin * normal[2];
    mju_addToScl3(mended.pos, mended.normal, -0.25 * margin * normal[2]);
    if (mended.dist <= margin) contact[kept++] = mended;
  }
  return kept;
#else
  return count;
#endif
}

}  // namespace dashpot::host
