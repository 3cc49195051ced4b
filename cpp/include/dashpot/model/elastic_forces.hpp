// Forces on free bodies that change with positions: of springs, of servos, and the torque of what
// compensates the weight of some of the parts of a body.
//
// Free bodies move under a load that is constant over a step. Held as it is at the start, a spring
// multiplies their energy by 1 + (omega H)^2 / 2 in a step H. So these forces are those of where
// the velocity takes all bodies in half of the step:
//
//     v' = v + H a(x + H v / 2),   x' = x + H (v + v') / 2
//
// For a linear spring this map keeps areas; it is of second order, and leaves rest as it is.

#pragma once

#include <vector>

#include "dashpot/model/state.hpp"
#include "dashpot/rows/free_body.hpp"

namespace dashpot::host {

class ElasticForces {
 public:
  // Finds which free bodies such forces act on, and these in half of a step of `length` (s).
  void find(const mjModel_* m, const mjData_* d, double length);
  // Whether any acts on a tree, a free body.
  bool act_on(int tree) const { return any_ && acts_[tree]; }
  // What the wrench (world, at the centre of mass) on such a body changes by until then.
  Vector6 change(const mjModel_* m, const mjData_* d, int tree) const;
  // What the generalized forces (nv) of servos change by; empty where no force acts.
  const std::vector<double>& servo_change() const { return servo_change_; }

 private:
  void find_trees(const mjModel_* m, const mjData_* d);
  void mark(const mjModel_* m, int dof);
  void look_ahead(const mjModel_* m, const mjData_* d, double time);
  void add_tendons(const mjModel_* m, const mjData_* d);
  void add_servos(const mjModel_* m, const mjData_* d);
  void add_joints(const mjModel_* m, const mjData_* d);

  bool any_ = false;
  std::vector<char> acts_;                         // by tree
  OwnedData ahead_;                                // with kinematics alone
  std::vector<double> now_, then_, servo_change_;  // (nv)
};

// Elastic energy of flexes; MuJoCo's own potential energy has that of springs of lines alone.

// Energy (J) that stretched elements and bent edges of flexes store where the kinematics of `data`
// last left their vertices: what MuJoCo's passive forces, qfrc_spring, are the gradient of. None of
// flexes that are interpolated between nodes. Bending of curved shells does not count from zero.
double flex_energy(const mjModel_* m, const mjData_* d);

}  // namespace dashpot::host
