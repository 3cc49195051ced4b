// What may act in a step on bodies that fly.
//
// Contacts that touch or close, and constraints, disturb the trees that they join: where their
// flight leads is not known. What stands still and only holds what rests or slides on it, as a
// table a ball, takes it hardly from its smooth motion: with closing speed u, what smooth forces
// add to it in the step, du, and the speed x sqrt(k w) min(1, sqrt(k w) H) that its compression can
// give, by
//
//     H (2 u + du / 2 + x sqrt(k w) min(1, sqrt(k w) H))
//
// along its normal, and friction by no more. Trees with a larger departure are shaken.

#pragma once

#include <array>
#include <vector>

#include "dashpot/rows/memory.hpp"
#include "dashpot/rows/rows.hpp"

struct mjModel_;

namespace dashpot {

// Keeps its arrays from step to step.
class FlightDisturbance {
 public:
  // Begins a step of `length` (s), in which nothing is disturbed yet.
  void reset(const mjModel_* model, double length);
  // Marks trees whose departure is of interest.
  void look_at(const std::array<int, 2>& trees) { mark(trees, looked_at_); }
  // Whether a contact joins something fixed to one of these trees.
  bool may_be_held(const ContactInput& contact) const;
  // Lets such a contact disturb its trees, and shake them if they depart by more than `most` (m);
  // `rates` (m/s) are those of its gap at both ends of the step by smooth motion alone.
  void hold(const Memory& memory, const ContactInput& contact, const std::array<double, 2>& rates,
            double most);
  // Shakes trees that something else may act on, as hard as can be.
  void shake(const std::array<int, 2>& trees);
  // What is disturbed, or shaken, may come to anything that one of `contacts` joins to it.
  void spread(const std::vector<ContactInput>& contacts);

  // Whether one of the trees is disturbed, or shaken.
  bool is_disturbed(const std::array<int, 2>& trees) const { return any(disturbed_, trees); }
  bool is_shaken(const std::array<int, 2>& trees) const { return any(shaken_, trees); }
  // Whether all of the trees that move are shaken.
  bool are_shaken(const std::array<int, 2>& trees) const;
  // How far (m) both trees together depart from their smooth motion.
  double departure(const std::array<int, 2>& trees) const;

 private:
  double release_speed(const Memory& memory, const std::array<int, 2>& geom) const;
  static bool any(const std::vector<char>& marked, const std::array<int, 2>& trees);
  static bool mark(const std::array<int, 2>& trees, std::vector<char>& marked);

  const mjModel_* model_ = nullptr;
  double length_ = 0.0;
  std::vector<char> disturbed_, shaken_, looked_at_;  // by tree
  std::vector<double> departure_;                     // by tree
};

}  // namespace dashpot
