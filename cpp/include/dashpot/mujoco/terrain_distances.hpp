// Distances from height fields, which one version of MuJoCo has wrong.

#pragma once

struct mjData_;
struct mjPreContact_;

namespace dashpot::host {

// Mends the contacts of a geom and a height field, found within a margin (m), and returns how many
// of them are within it. MuJoCo 3.15 takes the margin off them one and a half times.
int mend_terrain_distances(const mjData_* d, int terrain, double margin, mjPreContact_* contact,
                           int count);

}  // namespace dashpot::host
