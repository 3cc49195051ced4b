// What a model's own solref means where a body is pressed between others.
//
// A motion of the mass M that loads one of MuJoCo's rows (solref.hpp) has, with the inertia 1/R
// that the row adds, the damping ratio b / (2 sqrt(d k (1 + M R))). A spring kappa = d k / R, which
// leaves that inertia out, gives it the same ratio with the damper
//
//     b / sqrt(R (R + 1/M)) ,
//
// which for a body alone, 1/M = A, is delta of solref.hpp, and for a heavy motion b / R, MuJoCo's
// own. How heavy the motion is, a contact's own inverse mass w says, the sum of what either side
// adds, unless a body is pressed between others, as in a gripper: of what presses it, or presses it
// on against something else, the body itself is no part. Such a side adds nothing to 1/M.

#pragma once

#include <array>
#include <vector>

#include "dashpot/islands/group_material.hpp"
#include "dashpot/rows/rows.hpp"

struct mjModel_;

namespace dashpot {

// Keeps its arrays from step to step.
class ClampedBodies {
 public:
  // Sets the damping of contacts of bodies that are pressed between others and follow the model's
  // own solref.
  void find(const mjModel_* model, const std::vector<ContactInput>& contacts, const Rows& rows,
            std::vector<GroupMaterial>& materials);

 private:
  // A push on a body by a contact, along a unit vector of the world.
  struct Push {
    int body, tree;  // what is pushed, and what pushes
    std::array<double, 3> direction;
  };

  static Push push_of(const mjModel_* model, const ContactInput& input, int side);
  static bool any_opposed(const Push* first, const Push* last);
  void find_pressed_bodies(const mjModel_* model, const std::vector<ContactInput>& contacts,
                           const Rows& rows);
  bool is_pressed(int body) const;

  std::vector<Push> pushes_;  // sorted by body
  std::vector<int> pressed_;  // bodies that contacts push against each other, sorted
};

}  // namespace dashpot
