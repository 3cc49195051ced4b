// Contacts of geoms that lie flat on each other, as the points of their faces.
//
// MuJoCo keeps room for a pair's contacts by the types of its geoms: eight of two boxes, four of a
// mesh. What faces share beyond that waits until collision is done, and then goes in beside the
// pair's other contacts.

#pragma once

#include <array>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "dashpot/geometry/face_manifold.hpp"
#include "dashpot/geometry/flat_faces.hpp"
#include "dashpot/geometry/shallow_cap.hpp"

struct mjModel_;
struct mjData_;
struct mjPreContact_;

namespace dashpot::host {

// Least cosine between the normals of a face and of a contact on it.
inline constexpr double kOfFace = 0.999999;

// A contact that MuJoCo has no room for.
struct SurplusContact {
  std::array<int, 2> geom;
  double distance;
  std::array<double, 3> position, normal;
};

// Faces of the hulls of meshes, each made when first asked for, by whatever thread.
struct HullFaces {
  std::mutex mutex;
  std::vector<std::optional<std::vector<FlatFace>>> of_mesh;
  std::vector<std::optional<std::vector<HullFacet>>> facets_of_mesh;
};

// Kept from step to step: a step allocates nothing. Of one thread, but for the hulls.
struct FaceBuffers {
  std::shared_ptr<HullFaces> hulls = std::make_shared<HullFaces>();
  ShallowCap cap;
  std::vector<SurplusContact> surplus;
  const double* body_velocity = nullptr;  // see detect_again(); null: the present one
};

// Whether geoms of a type have faces to lie on: boxes, meshes, and cylinders with their flat ends.
bool has_faces(int type);
// Whether a geom has a face along a unit direction (world), its normal within `cosine` of it.
bool has_face_along(const mjModel_* m, const mjData_* d, int geom, const Eigen::Vector3d& direction,
                    double cosine, FaceBuffers& buffers);
// The normal of that face; none where there is none.
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

// Puts the points of the faces in place of the `count` contacts (at most mjMAXCONPAIR) that MuJoCo
// finds of two geoms, where these lie flat on each other; returns how many they are, 0 where they
// do not. Pairs of boxes, meshes, flat ends of cylinders and planes, of two boxes, and of capsules
// on boxes, only where MuJoCo finds a single point; and round sides on faces. Of a capsule on a box
// MuJoCo finds one end alone in half of all cases where it is parallel but for rounding.
int take_points_of_faces(const mjModel_* m, const mjData_* d, int geom1, int geom2, double margin,
                         FaceBuffers& buffers, mjPreContact_* contact, int count);

// After MuJoCo's collision, before its rows: adds contacts to those of their pairs, in the order in
// which it asked for them. Whether they fit into the memory of the model; if not, none are added.
bool add_surplus(mjData_* d, const std::vector<SurplusContact>& surplus);

}  // namespace dashpot::host
