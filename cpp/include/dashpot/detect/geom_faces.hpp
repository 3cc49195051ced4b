// Faces of geoms: of boxes, of the hulls of meshes, and the flat ends of cylinders.

#pragma once

#include <array>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "dashpot/geometry/face_manifold.hpp"
#include "dashpot/geometry/flat_faces.hpp"
#include "dashpot/geometry/hull.hpp"
#include "dashpot/geometry/shallow_cap.hpp"
#include "dashpot/model/mujoco_types.hpp"

namespace dashpot::host {

// A contact that MuJoCo has no room for. It keeps room for a pair's contacts by the types of its
// geoms: eight of two boxes, four of a mesh. What faces share beyond that waits until collision is
// done, and then goes in beside the pair's other contacts.
struct SurplusContact {
  std::array<int, 2> geom;
  double distance;
  std::array<double, 3> position, normal;
};

// After MuJoCo's collision, before its rows: adds contacts to those of their pairs, in the order in
// which it asked for them. Whether they fit into the memory of the model; if not, none are added.
bool add_surplus(mjData_* d, const std::vector<SurplusContact>& surplus);

// Least cosine between the normals of a face and of a contact on it.
inline constexpr double kOfFace = 0.999999;

// Hulls of meshes and their faces, each made when first asked for, by whatever thread.
struct HullFaces {
  std::mutex mutex;
  std::vector<std::optional<std::vector<FlatFace>>> faces_of_mesh;
  std::vector<std::optional<CoarseHull>> of_mesh;
};

// Kept from step to step: a step allocates nothing. Of one thread, but for the hulls.
struct FaceBuffers {
  std::shared_ptr<HullFaces> hulls = std::make_shared<HullFaces>();
  ShallowCap cap;
  std::vector<SurplusContact> surplus;
};

// The face of a geom, a box, a mesh or a cylinder, that looks along a direction.
struct GeomFace {
  int geom = -1, type = -1;
  Pose pose;
  const FlatFace* face = nullptr;  // of a mesh
  Eigen::Vector3d normal = Eigen::Vector3d::Zero();

  GeomFace(const mjModel_* m, const mjData_* d, int id);
  // Whether there is any.
  bool find(const mjModel_* m, const Eigen::Vector3d& direction, FaceBuffers& buffers);
  bool is_flat(const Eigen::Vector3d& direction) const;
  // `up`: out of what it lies on.
  PlacedFace place(const mjModel_* m, const Eigen::Vector3d& up) const;
};

// Finds what of a mesh all but lies flat on something, `width` (m) wide, in `buffers`; `up`: out of
// that. False of others.
bool find_cap(const mjModel_* m, const GeomFace& mesh, const Eigen::Vector3d& up, double width,
              FaceBuffers& buffers);

// Whether geoms of a type have faces to lie on: boxes, meshes, and cylinders with their flat ends.
bool has_faces(int type);
// The normal of a geom's face along a unit direction (world), within `cosine` of it, or none.
std::optional<Eigen::Vector3d> face_normal_along(const mjModel_* m, const mjData_* d, int geom,
                                                 const Eigen::Vector3d& direction, double cosine,
                                                 FaceBuffers& buffers);
// The face of a mesh that lies flat along a direction, within `tilt` (rad), placed as `pose` says:
// the corners that stand for all. None where there is none.
std::optional<PlacedFace> flat_face_along(const mjModel_* m, int geom, const Pose& pose,
                                          const Eigen::Vector3d& direction, double tilt,
                                          FaceBuffers& buffers);

// Both ends (m) of the edge through `point`, within `tolerance` (m) of it, that runs nearly along
// `along`, of the face of a box or a mesh that looks along `outward` most. Directions are unit
// vectors; all in the world. None where there is no such edge.
std::optional<std::array<Eigen::Vector3d, 2>> edge_through(const mjModel_* m, const mjData_* d,
                                                           int geom, const Eigen::Vector3d& point,
                                                           const Eigen::Vector3d& outward,
                                                           const Eigen::Vector3d& along,
                                                           double tolerance, FaceBuffers& buffers);

}  // namespace dashpot::host
