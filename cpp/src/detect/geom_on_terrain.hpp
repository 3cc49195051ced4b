// A geom on a height field, and what of it lies flat there.

#pragma once

#include <Eigen/Core>
#include <optional>

#include "dashpot/geometry/face_manifold.hpp"
#include "dashpot/geometry/shape.hpp"
#include "dashpot/geometry/terrain.hpp"
#include "dashpot/model/mujoco_types.hpp"

namespace dashpot::host {

struct FaceBuffers;

// The round surfaces with which geoms touch terrain: a ball's, an ellipsoid's, a capsule's ends.
class RoundSurfaces {
 public:
  RoundSurfaces(const mjModel_* m, int geom);

  int count() const { return count_; }  // 0 of geoms that touch with corners and rims
  // The lowest points of a surface, by the unit normal along which they are, where the geom is in
  // `pose`; both in the frame of that. Refers to the surfaces and the pose.
  auto lowest(int surface, const Pose& pose) const {
    return [this, surface, &pose](const Eigen::Vector3d& normal) {
      return lowest_along(normal, surface, pose);
    };
  }

 private:
  Eigen::Vector3d lowest_along(const Eigen::Vector3d& normal, int surface, const Pose& pose) const;

  Eigen::Vector3d half_;  // half-axes, m
  double half_length_ = 0.0;
  int count_ = 0;
};

// All but `frame` in the frame of the field, where the geom is when this is made.
struct GeomOnTerrain {
  GeomOnTerrain(const mjModel_* m, const mjData_* d, int terrain_id, int geom_id, double within,
                FaceBuffers& face_buffers);
  GeomOnTerrain(const GeomOnTerrain&) = delete;  // the terrain refers to the field
  GeomOnTerrain& operator=(const GeomOnTerrain&) = delete;

  Eigen::Vector3d to_local(const Eigen::Vector3d& point) const {
    return frame.rotation.transpose() * (point - frame.position);
  }
  bool has_round_surfaces() const { return round.count() > 0; }
  // From the rim or the base of the field to a point inside.
  double inward_way(const Eigen::Vector3d& point) const;
  // Whether a triangle is part of a larger flat one.
  bool has_flat_edge(const TerrainTriangle& triangle) const;
  // The face, or the line of a side, that lies flat on a triangle; and what they share.
  std::optional<PlacedFace> turned_to(const TerrainTriangle& triangle) const;
  FaceManifold shared_with(const TerrainTriangle& triangle) const;

  const mjModel_* model;
  int id;
  double margin;  // m
  double radius;  // m, of the geom about its centre
  FaceBuffers& buffers;
  HeightField field;
  Terrain terrain;
  RoundSurfaces round;
  Pose frame, pose;    // of the field in the world, of the geom in the field
  Eigen::Vector3d up;  // normal of the terrain beneath the centre of the geom
  // It touches with a round side: on surfaces that bend everywhere what MuJoCo finds of that is
  // right. The rest is corners, and an ellipsoid's lowest point, which are right on every triangle.
  bool on_side;
};

}  // namespace dashpot::host
