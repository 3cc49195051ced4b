// Shapes, poses and motions of the geoms of a MuJoCo model. Part of the MuJoCo host.

#pragma once

#include <vector>

#include "dashpot/geometry/query.hpp"
#include "dashpot/model/mujoco_types.hpp"

namespace dashpot {

namespace host {

// Vertices of a mesh's hull in its frame, m; all where there is no hull. The model must outlive it.
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

}  // namespace host

// A height field of the model, `id` in [0, nhfield), its heights borrowed.
HeightField height_field(const mjModel_* model, int id);

// The same, m, in columns.
Eigen::Matrix3Xd hull_vertices(const mjModel_* model, int mesh);

// The shape of a geom; a mesh gives its convex hull, a height field borrows its heights from the
// model. `geom` in [0, ngeom). Throws std::invalid_argument naming the geom where it is a signed
// distance field, or has a bad size.
Shape geom_shape(const mjModel_* model, int geom);

// Shapes of geoms, each made when it is first asked for, or has another type or mesh: a mesh's
// vertices are copied once, and where they alone are edited later, that goes unseen. Sizes and
// heights of fields are read anew, for they may be edited between steps. Throws as geom_shape does.
class GeomShapes {
 public:
  const Shape& of(const mjModel_* model, int geom);

 private:
  struct Known {
    Shape shape;
    int type = -1, data = -1;  // geom_type and geom_dataid that it was made of
  };
  std::vector<Known> shape_;  // by geom
};

// The pose of a geom as the data's kinematics last left it (geom_xpos, geom_xmat), as
// mj_geomDistance has it. The second one throws std::invalid_argument naming the geom where its
// position is not finite, or its axes are no rotation.
Pose unchecked_geom_pose(const mjData_* data, int geom);
Pose geom_pose(const mjModel_* model, const mjData_* data, int geom);

// The velocity of its body, at the body's centre of mass, or, of a free body, that of all that is
// welded together, as the data's kinematics last left it (cvel). Throws std::invalid_argument
// naming the geom where it is not finite.
Motion geom_motion(const mjModel_* model, const mjData_* data, int geom);

// Whether queries cover the type of a geom: all but signed distance fields.
bool has_shape(const mjModel_* model, int geom);

// How thick a geom is, how far it reaches, and how round it is.
struct GeomBounds {
  double half_width = 0.0;     // m, of its least width (a mesh: along its axes; a plane: infinite)
  double core_radius = 0.0;    // m, of its core about its centre (a plane: 0)
  bool is_revolution = false;  // turning about its z axis leaves it as it is
  bool is_round = false;       // its surface is curved everywhere, in one direction at least
};
GeomBounds geom_bounds(const mjModel_* model, int geom);

// Motion of a body, `centre` as in geom_motion, of its spatial velocity: rotation and translation
// (6) about the centre of mass of its tree, as in cvel.
Motion body_motion(const mjModel_* model, const mjData_* data, int body, const double* spatial);
// Motion of every body for velocities `qvel` (nv) at the positions of `data`, as body_motion.
std::vector<Motion> body_motions(const mjModel_* model, const mjData_* data, const double* qvel);

int geom_body(const mjModel_* model, int geom);
// Distance (m) of the centre of a geom from `point` (m, world).
double geom_offset(const mjData_* data, int geom, const Eigen::Vector3d& point);

// Every geom that takes part in collisions (contype or conaffinity set), in the order of their ids,
// grouped by the bodies they are welded to. `body` >= 0 marks the geoms of that body as of
// interest, -1 all. Throws as geom_shape and geom_pose do.
std::vector<PlacedShape> placed_shapes(const mjModel_* model, const mjData_* data, int body);

}  // namespace dashpot
