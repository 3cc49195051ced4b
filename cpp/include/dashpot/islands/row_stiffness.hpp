// Stiffness and damping of rows.
//
// A material in SI units gives them in N/m and N s/m. Rigid rows are as stiff as micro-steps of h
// resolve: k = kappa / w, d = delta / w, w of normals being the mean of the contacts between two
// bodies (modal_damping.hpp). In units where diag(A) = 1 let c be their bound. The flow
// of every row on its own is exact, so only the coupling c - 1 has to be resolved:
//
//     kappa (c - 1) h^2 <= theta^2,   kappa h^2 <= kStiffestAlone,
//     delta_n (c_n - 1) h <= theta,   delta_t (c_t - 1) h <= theta
//
// with theta = kRigidResolution and c_n and c_t for the damping of normals and of friction, dry
// friction too. Of what is hit, and of springs that a material or a model gives, friction has one k
// and one d along both tangents, so that it knows no heading: by the mean m of their two w, rows
// have w / m of the kappa and delta above, and up to twice as much of those that are resolved. A
// damping ratio is that of the contact alone, delta = 2 zeta sqrt(kappa), as far as the bounds
// allow; for a restitution kappa gives way as far as a weight sags no further than kInelasticSag,
// what dry friction holds no further than kRigidSag. Friction of a rigid hit whose normal is more
// than critically damped is so by twice as much, and its kappa gives way to that. A model's own
// solref is a kappa and a delta of normals, as far as the bounds allow: what they leave out of a
// delta that is more than critical adds to kappa. Its friction is as rigid as these allow, for
// MuJoCo's has no spring either: on one as soft as the normal's a Go1 trotted 0.42 m, not 0.6. A
// material in SI units that micro-steps do not resolve is rigid, no stiffer than it says, and has
// its damping ratio as far as the bounds allow.

#pragma once

#include <limits>

#include "dashpot/islands/group_material.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot {

inline constexpr double kRigidResolution = 1.0;  // theta of rigid rows
// kappa h^2 of rows that nothing is coupled to. Their flow is exact at any value; this leaves them
// as stiff at the longest rigid micro-step as others are with theta.
inline constexpr double kStiffestAlone = 1.5;
inline constexpr double kRigidMicrostep = 2.5e-4;     // s, longest micro-step of rigid contacts
inline constexpr double kRigidSag = 1.0e-3;           // of a body's radius, see below
inline constexpr double kInelasticSag = 1.0e-4;       // the same where stiffness gives way
inline constexpr double kRoundingOfBounds = 1.0e-12;  // relative, of quotients and roots

// Whether a value is within a bound, but for the last bits.
inline bool fits(double value, double bound) { return value <= bound * (1.0 + kRoundingOfBounds); }

// In which time (s) a weight, the dry friction of joints, and the load that a contact bore in the
// last step, move a body by the sag that a rigid contact may have, sqrt(sag / acceleration).
// Infinite for groups that bear no weight or move no joint with friction; 0 where no load is known.
struct DeflectionTime {
  double weight = std::numeric_limits<double>::infinity(), dry_friction = weight, load = 0.0;
};

// Bounds on the coupling of rigid rows whose own entry is 1: of their stiffness, c, of the damping
// of normals, c_n, and of that of friction, c_t.
struct RigidCoupling {
  double stiffness = 0.0, normal_damping = 0.0, friction_damping = 0.0;
};

// kappa h^2 of the stiffest rigid rows whose stiffness has the bound c.
double stiffest_rigid(double bound);

// Fills the rows of a group from its material in SI units, resolved or not. Rotational rows get the
// stiffness that gives them the natural frequency of the sliding rows, or that of sliding as easy
// as the normal gives way where that is higher.
void fill_given_rows(Rows& rows, const RowGroup& group, const Material& material);

// A micro-step (s), one no shorter that limits stiffness, and whether it is one of a hit.
struct RigidMicrostep {
  double duration = 0.0, of_stiffness = 0.0;
  bool hit = false;
};

// Fills the rows of a rigid group, or lowers those that fill_given_rows() filled to what
// micro-steps resolve. Returns whether nothing that was given was lowered.
bool fill_rigid_rows(Rows& rows, const RowGroup& group, const GroupMaterial& given,
                     const RigidCoupling& coupling, const DeflectionTime& deflection_time,
                     const RigidMicrostep& microstep);

// Longest micro-step (s) at which a rigid group is stiff enough for a heavy body on a light one, or
// for one that is driven against dry friction, and as damped as its restitution says at the
// stiffness that weights need. Rows of a model's own solref need not be stiffer than it says.
double longest_rigid_microstep(const Rows& rows, const RowGroup& group, const GroupMaterial& given,
                               const RigidCoupling& coupling,
                               const DeflectionTime& deflection_time);

}  // namespace dashpot
