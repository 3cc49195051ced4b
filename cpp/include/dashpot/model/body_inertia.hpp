// Inertia that follows edits of a model, and that of free bodies of several parts.
//
// Of several parts: bodies without joints, welded to the one with the free joint, are
// of one rigid body with it.
//
// Body b of mass m_b, centre of mass c_b and inertia I_b about it, all in the frame of the root:
//
//     m = sum m_b,   c = sum m_b c_b / m,   r_b = c_b - c,
//     I = sum I_b + m_b (|r_b|^2 1 - r_b r_b')

#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot::host {

// The inertia of such a body.
class WeldedParts {
 public:
  // Reads masses, inertias and places in the model, which may have been edited. Throws
  // std::invalid_argument naming the body unless it has mass, and inertia about every axis.
  void read(const mjModel_* m, int tree);

  double mass() const { return mass_; }                      // kg
  const Eigen::Vector3d& offset() const { return offset_; }  // of the centre of mass, root frame, m
  const Eigen::Quaterniond& principal() const { return principal_; }  // axes to root frame
  const Eigen::Vector3d& moments() const { return moments_; }         // kg m^2

 private:
  struct Part {
    Eigen::Vector3d position;        // root frame
    Eigen::Quaterniond orientation;  // to root frame
  };
  void find_principal_axes();

  std::vector<Part> part_;  // by body from the root on
  double mass_ = 0.0;
  Eigen::Vector3d offset_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d inertia_ = Eigen::Matrix3d::Zero();  // of which the principal axes are
  Eigen::Quaterniond principal_ = Eigen::Quaterniond::Identity();
  Eigen::Vector3d moments_ = Eigen::Vector3d::Zero();
};

// Whether a tree is a free body of several parts.
bool has_welded_parts(const mjModel_* m, int tree);

// Reads the parts of all trees that have some, by tree; there are none where no tree has.
void read_welded_parts(const mjModel_* m, int trees, std::vector<WeldedParts>& parts, Team& team);
// Those of one tree; null without.
const WeldedParts* parts_of(const mjModel_* m, const std::vector<WeldedParts>& parts, int tree);

// The point of a body that its motion is best told by: the centre of mass of the rigid body that it
// is a part of, if that is free, and otherwise its own. World, m.
const double* centre_of_motion(const mjModel_* m, const mjData_* d, int body);

// What MuJoCo derives from masses when it compiles a model: inertia of the degrees of freedom that
// it calls simple, masses of subtrees, and typical inverse masses.
//
// A body without children whose inertial frame is its own frame, as most free boxes and balls are,
// has a diagonal inertia that does not depend on its pose. MuJoCo reads it from a constant,
//
//     dof_M0 = mass or principal moment + armature ,
//
// which mj_setConst computes, while weight comes from body_mass itself: where a mass was edited
// alone, bodies would fall by the new weight on the old inertia. The work of gravity is that of the
// weights of subtrees, body_subtreemass. What is small near a singular configuration, and how stiff
// a solref is, go by body_invweight0, dof_invweight0 and tendon_invweight0, the inverse inertia in
// the pose of the model.

// Throws std::invalid_argument naming a body whose mass or moment of inertia is not finite, is
// negative, or is 0 where simple degrees of freedom need it.
void check_masses(const mjModel_* m);

// Of masses that check_masses has passed, sets dof_M0 of simple degrees of freedom,
// body_subtreemass and the inverse masses where body_mass, or body_inertia or dof_armature of a
// simple degree of freedom, was edited since; where others than lone free bodies were, by
// mj_setConst in a copy of the model. What differs in rounding alone stays: once this was called,
// threads that share a model's arrays and call it do not write to them.
void follow_edited_masses(mjModel_* m);

}  // namespace dashpot::host
