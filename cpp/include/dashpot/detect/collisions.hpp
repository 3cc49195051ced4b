// Collisions of MuJoCo that detection replaces.
//
// Boxes: MuJoCo finds nothing between boxes that are apart and face each other with corners or
// edges. Under a widened reach such contacts may start in the step: that of the nearest points.
//
// Boxes, meshes and ends of cylinders that lie flat on each other, meshes on planes: of two faces
// tilted by a hair MuJoCo finds one crossing of their edges in some steps, and of those of meshes
// some of the points that they share, other ones from step to step. There contacts are all of these
// (face_manifold.hpp), but not for the complementarity-free law, which has MuJoCo's.
//
// Shapes whose nearest points MuJoCo searches for, all but spheres, planes and the pairs of
// capsules and boxes: a search ends with a tolerance on the distance, a micrometre unless a model
// says otherwise, which is what rigid contacts overlap by. It leaves the normal of curved shapes
// open by some 0.003 rad, that of a cylinder along an edge by 0.5. Here it goes on to a thousandth
// of that. Then MuJoCo clips faces against each other for more points, which need not be those that
// touch. Here the nearest points stay unless geoms lie flat (detect/face_contacts.hpp) or side by
// side (detect/face_contacts.hpp).
//
// Points on height fields are those of detect/terrain.hpp.

#pragma once

#include "dashpot/model/mujoco_types.hpp"

namespace dashpot::host {

struct FaceBuffers;
class Narrowing;

// While it lives, collisions of this thread and model are those; others stay as they are. Contacts
// that MuJoCo looks for are narrowed where `narrowing` is there. Faces that lie flat give their
// points where there are buffers for them; what MuJoCo has no room for waits there.
class ReplacedCollisions {
 public:
  // The model whose collisions are replaced, and with what.
  struct Of {
    mjModel_* model = nullptr;
    FaceBuffers* faces = nullptr;
    Narrowing* narrowing = nullptr;
  };

  ReplacedCollisions(mjModel_* m, FaceBuffers* faces, Narrowing* narrowing);
  ~ReplacedCollisions();
  ReplacedCollisions(const ReplacedCollisions&) = delete;
  ReplacedCollisions& operator=(const ReplacedCollisions&) = delete;

 private:
  mjModel_* model_;
  int flags_;  // its own: an error of MuJoCo leaves what is changed for one pair
  double tolerance_;
  Of outer_;  // a callback of collision may step another model
};

// Distance (m) of two convex geoms, at most `most`; while collisions are replaced.
double distance_of_convex(const mjModel_* m, mjData_* d, int geom1, int geom2, double most);

// The contacts (room for mjMAXCONPAIR) that present collisions find of two geoms; returns how many.
int collide_all(const mjModel_* m, mjData_* d, int geom1, int geom2, double margin,
                mjPreContact_* contact);

}  // namespace dashpot::host
