// Work of the smooth forces over a step.
//
// A step solves (M + H D) dv = f dt + J'dp with f the smooth forces at its start, D what the
// effective inertia has of dampers and actuators (mujoco/effective_inertia.hpp) and p the impulses
// of the rows, which may come at any time in it. So
//
//     v(t) = v0 + a t + u(t),    a = inv(M + H D) f,    u = inv(M + H D) J'p,
//     change of v'M v / 2 = f'x + (work of the rows) - H (v1' D v1 - v0' D v0) / 2
//
// with x the displacement, the integral of v. Without rows x = H (v0 + v1) / 2, and of f = -D v0
// these terms take H v1' D (v0 + v1) / 2, what a damper of force D v1 dissipates.
//
// Rows that change the velocity within a moment do the work of H D du beside that of M du, as if
// H D were inertia; the terms above give that energy back. No damper does: it brakes at the
// velocities that there are. So of a tree that rows moved, with g the damping force at v0,
//
//     dissipated = x' (D (w - v0) - g),    w = x / H + s (v1 - v0) / 2,
//
// w being the mean velocity and the implicit half step beyond it. Where rows act evenly over the
// step, as dry friction does, s is 1 and nothing differs, since x = H (v0 + v1) / 2. An impact
// leaves a mean velocity nearer to that before it or to that after it, by up to half of v1 - v0.
// Twice that much s takes from v1 - v0, but nothing of what smooth forces change. With sizes in the
// norm of D,
//
//     s = max(1 - 2 |x / H - (v0 + v1) / 2| / |v1 - v0|, H |a| / |v1 - v0|),    at most 1.
//
// What the rows dissipated changes by the difference; so it does by that of the work of actuators,
// by the part of D that is theirs. An error of order H remains in steps with impacts, whose time
// within the step is not known here; of a damper that would stop the motion within a step it can be
// more than there is energy. But passive dampers dissipate no less than nothing, and no more than
// what they and the rows took from the motion together.
//
// Dampers of damped trees (trees.hpp) brake at the velocities that there are, but for the part
// e D in H: they take, as counted in the micro-steps,
//
//     integral of v'D (v - v0) dt - x'g  +  s e (v1'D v1 - v0'D v0) / 2 ,
//
// the last being what is left to rows with 1 - s.

#pragma once

#include <vector>

#include "dashpot/rows/trees.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// How a step moved: generalized velocity at its start, displacement that the change of kinetic
// energy goes with (the integral of velocity, or H (v0 + v1) / 2 where MuJoCo's integrator moved
// the tree), smooth acceleration (nv each); by tree whether rows moved it, and whether it went as
// in the micro-steps.
struct StepMotion {
  const double *start_velocity, *displacement, *acceleration;
  const std::vector<char>* touched;
  const std::vector<char>* in_microsteps;
  const double* braked;  // RowData::braked
  // Mean change of springs over a way in the micro-steps (nv); empty where none act there.
  const std::vector<double>& spring_change;
};

// Work (J) over a step that has just been integrated: of dampers and fluids, and of actuators,
// applied forces and gravity compensation. Keeps its arrays from step to step.
class SmoothWork {
 public:
  void find(const mjModel_* m, mjData_* d, const Trees& trees, const StepMotion& motion);

  double damping = 0.0, applied = 0.0;
  // By tree, the first one of those that damped tendons couple it to. By such a first tree, what is
  // left for the rows on its trees to have dissipated beside what they took from the bodies.
  std::vector<int> group;
  std::vector<double> left_to_rows;

 private:
  // Energy taken from the motion (J) by the terms of the integrator, and at the mean velocity.
  struct Braking {
    double integrated = 0.0, at_mean = 0.0;
    bool differs() const { return integrated != at_mean; }
    void operator+=(const Braking& other) {
      integrated += other.integrated;
      at_mean += other.at_mean;
    }
  };
  void find_braking(const mjModel_* m, mjData_* d, const Trees& trees, const StepMotion& motion);
  double kept_change(const mjModel_* m, const mjData_* d, const Trees& trees, const Tree& t,
                     const StepMotion& motion) const;
  static double work_of_drag(const mjModel_* m, const mjData_* d, const Trees& trees,
                             const Tree& tree, double sign, const StepMotion& motion);
  Braking implicit_braking(const mjModel_* m, const mjData_* d, const Trees& trees, int tree,
                           double kept, double sign, const StepMotion& motion) const;
  void find_losses(const mjModel_* m, const mjData_* d, const Trees& trees,
                   const StepMotion& motion);
  void find_mean_forces(const mjModel_* m, const mjData_* d, const Trees& trees,
                        const StepMotion& motion);

  // By first tree: dampers; actuators, what is implicit of them; what dampers and rows took, J;
  // whether rows moved any of the trees.
  std::vector<Braking> dampers_, actuators_;
  std::vector<double> lost_;
  std::vector<char> touched_;
  std::vector<double> kept_;  // s, by tree
  // By degree of freedom: v1 - v0, x / H - v0, x / H - (v0 + v1) / 2, M (v1 - v0), v1.
  std::vector<double> change_, mean_change_, unevenness_, momentum_, end_velocity_;
  // By degree of freedom, means over the step: of smooth forces but those of dampers; of driving
  // forces; of dampers, less what the effective inertia takes of them.
  std::vector<double> undamped_force_, driving_force_, damping_force_;
};

}  // namespace dashpot::host
