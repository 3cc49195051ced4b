// Elastic energy of flexes, which MuJoCo's own potential energy has for edge springs of lines
// alone.

#pragma once

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// Energy (J) that stretched elements and bent edges of flexes store where the kinematics of `data`
// last left their vertices: what MuJoCo's passive forces, qfrc_spring, are the gradient of. None of
// flexes that are interpolated between nodes. Bending of curved shells does not count from zero.
double flex_energy(const mjModel_* m, const mjData_* d);

}  // namespace dashpot::host
