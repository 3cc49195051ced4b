// The corners of a mesh's convex hull.

#pragma once

#include <Eigen/Core>

struct mjModel_;

namespace dashpot::host {

// The vertices of the hull in the frame of the mesh, m; all of the mesh where the model holds no
// hull. The model must outlive it.
class HullVertices {
 public:
  HullVertices(const mjModel_* m, int mesh);

  int count() const { return count_; }
  Eigen::Vector3d at(int i) const {
    const float* const v = vertex_ + 3 * (of_hull_ ? of_hull_[i] : i);
    return {v[0], v[1], v[2]};
  }

 private:
  const float* vertex_;           // of the mesh
  const int* of_hull_ = nullptr;  // the hull's among them; null: all
  int count_;
};

}  // namespace dashpot::host
