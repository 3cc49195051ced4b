// How much of the Verlet corrector of a step (trapezoid.hpp, with the symbols) trees take.
//
// Those that equalities couple share s, which is 1 to first order in H and conserves energy:
//
//     v1'M1 v1 / 2 = v'M0 v / 2 + ((p0 + p1) / 2 - f0) dq + integral of lambda (dJ/dt xi) t dt ,
//
// beside (e1 - e0) dq / 2, the work that changes of drives do, and less what D, the damping in the
// effective inertia, takes: tau v'D k + tau k'D k / 2, k = v1 - v, where that inertia is M + tau
// D. v: what the step left, v1: with the Verlet corrector; p: the part of f that has a potential, p
// - c; dq: displacement over the step. The first term is the energy that the frozen geometry of the
// step has; the second replaces the work of f0 by the change of potential energy; the last is the
// work that equalities did because they turned.
//
// An impact or a configuration near a singular one leaves no s near 1. Trees that equalities tie to
// what does not move are then brought to v1'M1 v1 / 2 by their speed where that takes some of it
// away. So is a tree that only contacts and limits hold, unless much of it would have to be added,
// and where the Verlet corrector would be a large part of its velocity.
//
// Nor is there an s where a linkage goes on smoothly and the power of the Verlet corrector passes
// through zero: what is left to conserve is of the order (omega H)^3, and no s has a part in it.
// All of it is taken then, and the speed of those tied to what does not move is made right after
// it, by at most kSmooth of it.
//
// All this goes by the motion beside the translations that the trees have in common, whose momentum
// nothing of it changes (CommonTranslations): `inside`.
//
// Springs, weights and servos alone need no such s: at turning points energies determine none.
// Where they bring most of the Verlet corrector, and are restoring,
//
//     0 < -(df dq) H^2 / (dq'M dq) <= 4,      df: by what they have changed,
//
// it is taken as it is, s = 1: velocity Verlet, whose energy is bounded up to there.

#pragma once

#include <array>
#include <vector>

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/rows.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot {

// Translations that trees which equalities couple have in common: what nothing holds, as a linkage
// in space, goes in three directions, one on a carriage along its rail, one on the ground in none.
//
// A translation turns no row, and what the rows of the trees exchange does not change its momentum.
// So how fast a linkage turns, and what its energy has to be made up for, is a matter of the motion
// beside it; all the same whether its carriage stands or goes at 5 m/s.
inline constexpr int kDirections = 3;

class CommonTranslations {
 public:
  // Of trees coupled by equality rows, that have one first tree (find_coupled_trees).
  void find(const mjModel_* model, const mjData_* d, const Rows& rows, const Trees& trees,
            const std::vector<int>& first_tree);
  // How many directions the trees of a first one have in common.
  int count(int first) const { return count_[first]; }
  // Whether any trees have the one of this number.
  bool any(int direction) const { return any_[direction]; }
  // The motion of all trees at 1 m/s along their directions, by motion coordinate; 0 without one.
  const std::vector<double>& motion(int direction) const { return motion_[direction]; }

 private:
  // What the first tree could do alone: unit vectors of the world; count -1 where nothing asks.
  struct Candidates {
    int count = -1;
    std::array<double, 3 * kDirections> direction{};
  };
  void find_common(int direction, const mjModel_* model, const mjData_* d, const Rows& rows,
                   const Trees& trees, const std::vector<int>& first_tree);

  std::vector<int> count_;              // by first tree
  std::vector<Candidates> candidates_;  // by the same
  std::vector<char> is_common_;         // by the same, of one direction
  std::array<bool, kDirections> any_{};
  std::array<std::vector<double>, kDirections> motion_;
};

// Of a translation: the mass that goes along (kg), and the momentum (kg m/s) that is in v and in k;
// no mass where there is no such translation.
struct CommonMomentum {
  double mass = 0.0, of_velocity = 0.0, of_half = 0.0;
  double velocity(double s) const { return mass > 0.0 ? (of_velocity + s * of_half) / mass : 0.0; }
};

// Of trees that equalities couple, or one that other rows may hold, J: v'M v / 2, v'M k and k'M k
// / 2 with k the whole Verlet corrector, the kinetic energy that there ought to be, and the work
// that rows did because they turned.
struct CoupledEnergy {
  double kinetic = 0.0, linear = 0.0, square = 0.0, wanted = 0.0, turning_work = 0.0;
  double damped_linear = 0.0, damped_square = 0.0;  // tau v'D k and tau k'D k / 2
  // J, what dampers take of k beyond what the work of the step has of it, where D counts as inertia
  // for another time than in the last step.
  double damped_beside = 0.0;
  double driven = 0.0;  // work of (e1 - e0) / 2
  double scale = 0.0;   // s
  double brake = 0.0;   // fraction of v + s k inside to take away where no s conserves energy
  // J, what it lacks with s of what it ought to be. Of a light part that an equality couples to a
  // heavy one s = 1 is a part of its own, which the damper of the equality takes.
  double lost = 0.0;
  bool by_equalities = false;
  bool held = false;            // in the last step, at least one tree, by rows that have a position
  bool left_corrector = false;  // in the last step, at least one tree
  bool turns = true;            // its equalities, in this step
  bool follows_drives = true, drives_change = false;
  // -(df dq) H^2, dq'M dq, and r'M r, r what df has no part in of the Verlet corrector.
  double restoring = 0.0, way = 0.0, rest = 0.0;
  std::array<CommonMomentum, kDirections> common;

  // Whether the three numbers above say that springs bring the Verlet corrector. Where `restoring`
  // is not positive they do not, and the others are not needed.
  bool is_of_springs(double most_rest) const;
  // A copy without what the Verlet corrector has brought, from which that is found again.
  CoupledEnergy anew() const;
  // 1 where springs bring the Verlet corrector, else find_root(), else 0.
  double find_scale() const;
  // The root nearest to 1 of kinetic + linear s + square s^2 = wanted, the damped ones beside, at
  // turning points of the motion the end of the range that comes as near; 0 if there is none.
  double find_root() const;
  // v1'M1 v1 / 2 with s, and what is in common translations of it.
  double energy_with(double s) const;
  double common_energy(double s) const;
  // v'M v / 2 and k'M k / 2 without what is in common translations.
  double inside() const { return kinetic - common_energy(0.0); }
  double half_inside() const;
  // Without s: the brake of what equalities tie to the ground or rows hold, and s of smooth motion.
  void correct_speed(bool on_ground);
};

// Of those without a scale that drives change, gives these up; whether there are any.
bool give_up_drives(std::vector<CoupledEnergy>& all);

// Finds for every tree the first one that equalities couple it to, -1 if none do: what they couple
// exchanges energy through them, and is conserved only of all together.
void find_coupled_trees(const Rows& rows, int trees, std::vector<int>& first_tree);

}  // namespace dashpot
