// The room that includes mujoco.h, in all files of its name or with "host" in theirs and those that
// say so: MuJoCo's stages in the order of mj_step, and what the
// contact solver reads from and writes to mjModel and mjData.
//
// mj_step is rebuilt from public calls; collision comes after the smooth acceleration, so that
// detection knows how far every body can move in this step.

#pragma once

#include <array>
#include <string>
#include <vector>

#include "dashpot/free_body.hpp"
#include "dashpot/law.hpp"
#include "dashpot/mujoco_faces.hpp"
#include "dashpot/mujoco_narrowphase.hpp"
#include "dashpot/mujoco_reach.hpp"
#include "dashpot/mujoco_seams.hpp"
#include "dashpot/rows.hpp"
#include "dashpot/runge_kutta.hpp"

struct mjModel_;
struct mjData_;

namespace dashpot::host {

// Beyond this MuJoCo itself calls a position, velocity or acceleration diverged (mjMAXVAL).
inline constexpr double kLargestValue = 1e10;

// How the engine treats one feature that a model uses, under a law.
enum class Treatment { kHonoured, kMapped, kRefused };
struct Feature {
  std::string name;
  Treatment treatment = Treatment::kHonoured;
  std::string note;
};
std::vector<Feature> features(const mjModel_* m, Law law);

// Throws std::invalid_argument naming every refused feature, a geom, pair or flex whose friction is
// negative or not finite, or a height of a field that is not finite.
void check_supported(const mjModel_* m, Law law);
// The same for the options and friction alone, which may be edited between steps. Also requires the
// elliptic cone, whose row layout force reports rely on, and a positive time step.
void check_options(const mjModel_* m, Law law);

// Whether all sizes of two models agree. This tells models apart where pickling has lost the
// signature of one of them or of its data: it is 0 then.
bool have_same_sizes(const mjModel_* a, const mjModel_* b);

// Throws std::invalid_argument if `d` was not made for `m` (whose data have `data_size`; of lost
// signatures the caller sees to have_same_sizes), or its state, controls or applied forces are not
// finite; names the field and the index.
void check_data(const mjModel_* m, const mjData_* d, long long data_size);

// How messages call an object of MuJoCo's type `type`: its name in quotes, or # and its id.
std::string named(const mjModel_* m, int type, int id);
// The same for a side of a contact: a geom, or the flex -1 - geom.
std::string contact_side(const mjModel_* m, int geom);

int geom_count(const mjModel_* m);
int tree_count(const mjModel_* m);  // without those joined to others
int dof_count(const mjModel_* m);
// Friction and priority of a side of a contact: a geom, or -1 - id for a flex.
std::array<double, 3> geom_friction(const mjModel_* m, int geom);
int geom_tree(const mjModel_* m, int geom);  // -1 for static ones
int geom_priority(const mjModel_* m, int geom);
// Radius (m) about the smaller geom of a contact; infinite if neither has one.
double contact_radius(const mjModel_* m, const ContactInput& input);
double gravity(const mjModel_* m);  // m/s^2; 0 if it is disabled
// Mass (kg) of the lighter of the kinematic trees whose geoms touch; infinite for flexes.
double contact_mass(const mjModel_* m, const ContactInput& input);
// MuJoCo's typical inverse mass (1/kg) of the geom's body in translation.
double geom_inverse_mass(const mjModel_* m, int geom);

// A step that may be taken in parts of their own time step. Where it was, the model's time step is
// restored at its end, and time has advanced by that step or, without finish(), the state at the
// start is back.
class StepParts {
 public:
  StepParts(mjModel_* m, mjData_* d);
  ~StepParts();
  StepParts(const StepParts&) = delete;
  StepParts& operator=(const StepParts&) = delete;

  double whole() const { return timestep_; }  // s
  bool cut() const { return !start_.empty(); }
  void set_length(double length);  // of the part, s; the first call cuts the step
  void finish() { finished_ = true; }

 private:
  mjModel_* model_;
  mjData_* data_;
  double timestep_, end_;
  bool finished_ = false;
  std::vector<double> start_;
};

// Spatial velocity (rotation, translation about the tree's centre of mass; 6 numbers in the world)
// of every body for generalized velocities `qvel`.
void body_velocities(const mjModel_* m, const mjData_* d, const double* qvel,
                     std::vector<double>& velocity);

// Trees that a single row may couple by more than two (a tendon over three bodies, a flex) are
// joined to one in the model, so that a row has at most two. Their number stays; the surplus ones
// are empty and last. Changes nothing else that MuJoCo computes.
void join_coupled_trees(mjModel_* m);
// Most degrees of freedom that joining puts into one tree; 0 where nothing is to be joined.
int coupled_dof_count(const mjModel_* m);
// Beyond this the dense inverse inertia of one tree takes longer than everything else.
inline constexpr int kMostCoupledDofs = 600;

// Number of geoms, and vertices of flexes, that may have contacts.
int contact_site_count(const mjModel_* m);
// Geoms that are only to be seen may still be named in a contact pair.
bool may_collide(const mjModel_* m, int geom);
// Meshes among them: their faces may have more corners than those of other geoms.
int colliding_mesh_count(const mjModel_* m);
int flex_count(const mjModel_* m);
bool has_equalities(const mjModel_* m);
bool has_adhesion(const mjModel_* m);  // of actuators or of geoms
int mocap_count(const mjModel_* m);

// Contact memory lives behind the model's own user data: `size` doubles.
void reserve_memory(mjModel_* m, int size);
double* memory(const mjModel_* m, mjData_* d, int size);
// Size of the main buffer of data made for this model: tells foreign data apart.
long long data_size(const mjModel_* m);

// Kinematics, inertia, bias, passive and actuator forces, smooth acceleration (qacc_smooth).
// `new_control` false: controls are held, the control callback is not asked.
void smooth_stage(const mjModel_* m, mjData_* d, bool new_control);

// MuJoCo's rows of contacts, which its force queries read: none, left out where the memory of the
// model is too small for them, or required.
enum class ContactRows { kNone, kIfTheyFit, kRequired };

// How to detect, and what detection keeps from step to step.
struct Detection {
  ContactRows contact_rows = ContactRows::kRequired;
  bool takes_faces = true;  // see mujoco_collisions.hpp
  FaceBuffers faces;
  ReachBuffers buffers;
  CandidatePairs candidates;
  Narrowphase narrowphase;
  SeamBuffers seams;
};

// Whether anything may read MuJoCo's rows of contacts within a step: sensors, plugins, and the
// contacts of flexes. Callbacks cannot: but for those of sensors they are asked before detection.
bool anything_reads_rows(const mjModel_* m);

// Collision and limits with a reach that covers the motion of every body and joint in this step,
// and MuJoCo's own constraint rows for what was found, those of contacts as `detection` asks. The
// model's gaps and margins are widened during the call and restored. Throws std::runtime_error
// where contacts or required rows exceed the memory of the model.
// `acceleration` is the smooth generalized acceleration over the step (nv).
void detect(mjModel_* m, mjData_* d, const std::vector<double>& acceleration, Detection& detection,
            std::vector<ContactInput>& contacts, std::vector<ConstraintInput>& constraints);
// The same once more in this step, with the reach that detection.buffers now ask for at least, and
// with the points where `body_velocity` (6 by body, as in cvel) leads in place of the present one.
void detect_again(mjModel_* m, mjData_* d, const std::vector<double>& acceleration,
                  const std::vector<double>& body_velocity, Detection& detection,
                  std::vector<ContactInput>& contacts, std::vector<ConstraintInput>& constraints);

// While it lives, `d` holds kinematics, inertia, contacts and constraint rows, those of contacts as
// `detection` asks, of the configuration to which smooth motion with `acceleration` (nv) brings it
// in half of the model's time step. At its end, also where detection throws, positions, kinematics
// and inertia are those of the present state again.
class MiddleGeometry {
 public:
  MiddleGeometry(mjModel_* m, mjData_* d, const std::vector<double>& acceleration,
                 Detection& detection, std::vector<ContactInput>& contacts,
                 std::vector<ConstraintInput>& constraints);

 private:
  // The configuration when it was made, put back into `d` at its end.
  class Start {
   public:
    Start(const mjModel_* m, mjData_* d);
    ~Start();
    Start(const Start&) = delete;
    Start& operator=(const Start&) = delete;

   private:
    const mjModel_* model_;
    mjData_* data_;
    std::vector<double> position_;
  };
  Start start_;
};

// Scalar constraints of the last detection, with the margins that the model sets.
void read_constraints(const mjModel_* m, const mjData_* d,
                      std::vector<ConstraintInput>& constraints);

// Whether solref (2) and solimp (5) are MuJoCo's defaults.
bool is_default_impedance(const double* solref, const double* solimp);

// Number of scalar constraints of the model that carry memory.
int constraint_memory_count(const mjModel_* m);

// The contacts of the last step as data still hold them.
void read_contacts(const mjModel_* m, const mjData_* d, std::vector<ContactInput>& contacts);
// Appends `count` contacts that are yet to be filled in, first in the arena, as mj_addContact has
// them; it forgets about rows each time. Whether they fit into the memory of the model; if not,
// none are added.
bool make_room_for_contacts(mjData_* d, int count);
// The frame (9) that MuJoCo gives a contact of this normal, and of a tangent where a collision
// finds one.
void set_frame(const double* normal, double* frame);
void set_frame(const double* normal, const double* tangent, double* frame);
// Gives a contact another position, normal (both world) and gap, also in `d`.
void redirect_contact(mjData_* d, const double* position, const double* normal, double gap,
                      ContactInput& contact);
int detected_count(const mjData_* d);
// Force and torque of a detected contact in its frame, N and N m. Throws std::runtime_error where
// the last step has left no rows of contacts.
std::array<double, 6> contact_force(const mjModel_* m, const mjData_* d, int index);
// Velocity (3, world, m/s) of a body at a point (world) for its `twist`, as in cvel: rotation, and
// translation at the centre of mass of its tree.
void velocity_of_point(const mjModel_* m, const mjData_* d, int body, const double* twist,
                       const double* point, double* velocity);
// The same at the velocities last computed.
void point_velocity(const mjModel_* m, const mjData_* d, int body, const double* point,
                    double* velocity);
// Velocity of geom 2 relative to geom 1 at the contact, in its frame (m/s), at the positions and
// velocities last computed.
std::array<double, 3> contact_velocity(const mjModel_* m, const mjData_* d,
                                       const ContactInput& input);

// The layout of trees in motion coordinates.
Trees make_trees(const mjModel_* m);

// The effective inertia M + H D, through which rows act, has D by integrator:
//     Euler          joint damping, as MuJoCo's Euler treats it implicitly
//     implicitfast   minus the symmetric derivatives of all smooth forces but the bias, as MuJoCo
//     implicit       the same; the derivative of the bias, which is not symmetric, is left out
//     RK4            half of the joint damping: the trapezoidal rule, of second order.
// Whether it comes from derivatives.
bool takes_derivatives(const mjModel_* m);
// Otherwise: the weight of joint damping in D.
double joint_damping_weight(const mjModel_* m);
// The derivative of the damping of a joint at `velocity`, and of the actuator that lends it
// damping, N s/m or N m s/rad.
double joint_damping(const mjModel_* m, int dof, double velocity);

// Computes the derivatives where they are needed.
void prepare_effective_inertia(const mjModel_* m, mjData_* d);
// Finds the effective inertia of every tree: the inverse for free bodies, for others the factor of
// factor_inertia.
void find_effective_inertia(const mjModel_* m, const mjData_* d, Trees& trees);
// The smooth generalized acceleration of a tree through the effective inertia.
void smooth_acceleration(const mjData_* d, const Trees& trees, int tree, double* acceleration);

// The trees that a row of MuJoCo's constraint Jacobian reaches, -1 where fewer than two. Throws
// std::invalid_argument if there are more.
std::array<int, 2> trees_of_row(const mjModel_* m, const mjData_* d, int source);
// Appends sparse rows for the group that was appended last, from `source` on in MuJoCo's.
void append_rows(const mjModel_* m, const mjData_* d, int source, const Trees& trees, Rows& rows);
// Appends the geometry or the sparse rows of a scalar constraint or contact, for the group that
// was appended last.
void append_jacobian(const mjModel_* m, const mjData_* d, const ConstraintInput& input,
                     const Trees& trees, Rows& rows);
void append_jacobian(const mjModel_* m, const mjData_* d, const ContactInput& input,
                     const Trees& trees, Rows& rows);

// dJ/dt xi of a row of an equality of bodies, joints or tendons, in m/s^2 or rad/s^2: how fast its
// rate changes while the motion coordinates keep theirs. Leaves out that spatial tendons turn.
double turning_of_equality(const mjModel_* m, const mjData_* d, int equality, int row,
                           const Trees& trees);

// MuJoCo's estimates of the inverse masses of a constraint's row, or of a contact's `dim` rows.
void typical_inverse_mass(const mjData_* d, const ConstraintInput& input, double* typical);
void typical_inverse_mass(const mjModel_* m, const mjData_* d, const ContactInput& input,
                          double* typical);

// Trees that are one free body without children.
bool is_free_body(const mjModel_* m, int tree);
// `acceleration` is the smooth generalized acceleration of the tree.
FreeBody read_free_body(const mjModel_* m, const mjData_* d, int tree, const double* acceleration);
Eigen::Quaterniond orientation(const mjModel_* m, const mjData_* d, int tree);
void write_free_body(const mjModel_* m, mjData_* d, int tree, const FreeBody& body);

const double* velocity(const mjData_* d);
void add_velocity(mjData_* d, const Tree& t, const double* change);  // by motion coordinate

// Smooth force on a degree of freedom at the start of the last step, N or N m: all of it; what
// follows from positions and velocities alone: bias, springs and gravity compensation; that of
// dampers and fluids; that of actuators, applied forces and gravity compensation.
double smooth_force(const mjData_* d, int dof);
double positional_force(const mjData_* d, int dof);
double damping_force(const mjData_* d, int dof);
double driving_force(const mjData_* d, int dof);
// The part of these that has a potential, from gravity, springs and gravity compensation.
double potential_force(const mjModel_* m, const mjData_* d, int dof);
// M x in generalized coordinates (nv), with the inertia last computed.
void times_inertia(const mjModel_* m, const mjData_* d, const double* x, double* product);

// Reports mean forces over the step: `constraint_force` (nv) generalized, `row_force` per contact
// row. Sets qfrc_constraint, qacc and efc_force, then evaluates acceleration sensors.
void report_forces(const mjModel_* m, mjData_* d, const std::vector<double>& constraint_force,
                   const std::vector<ContactInput>& contacts,
                   const std::vector<ConstraintInput>& constraints, const Rows& rows,
                   const std::vector<double>& row_force);

// MuJoCo's own integrator, under the mean forces that report_forces has set: advances everything
// (time, activations, plugins, trees without contact). `new_control` as in smooth_stage.
void integrate(const mjModel_* m, mjData_* d, bool new_control, RungeKutta& runge_kutta);
// Whether it takes smooth forces otherwise than through the effective inertia.
bool adds_to_smooth_motion(const mjModel_* m);

// Moves one tree by `displacement`, one entry per degree of freedom of it.
void move_tree(const mjModel_* m, mjData_* d, const Tree& tree, const double* displacement);
// Replaces the state of one tree by `velocity`, and by positions moved from `start_position` (nq)
// by `displacement`; both are generalized, one entry per degree of freedom of the tree.
void write_tree(const mjModel_* m, mjData_* d, const Tree& tree, const double* start_position,
                const double* displacement, const double* velocity);

const double* position(const mjData_* d);
int position_count(const mjModel_* m);

// How a step moved: generalized velocity at its start, displacement that the change of kinetic
// energy goes with (the integral of velocity, or H (v0 + v1) / 2 where MuJoCo's integrator moved
// the tree), smooth acceleration (nv each), and by tree whether rows moved it. `end`: smooth forces
// at the end of the step, null where the integrator does not ask for them, and by tree whether it
// moved under them.
struct StepMotion {
  const double *start_velocity, *displacement, *acceleration;
  const std::vector<char>* touched;
  const SmoothForces* end;
  const std::vector<char>* integrated;
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
  double kept_change(const mjModel_* m, const mjData_* d, const Tree& t,
                     const StepMotion& motion) const;
  Braking implicit_braking(const mjModel_* m, const mjData_* d, const Tree& t, double kept,
                           double sign, const StepMotion& motion) const;
  void find_losses(const mjModel_* m, const mjData_* d, const Trees& trees,
                   const StepMotion& motion);
  void find_mean_forces(const mjModel_* m, const mjData_* d, const StepMotion& motion);

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

// Work (J) of gravity and passive springs over a displacement (nv) from where the step started.
double potential_work(const mjModel_* m, const mjData_* d, const double* displacement);

// Copies everything that steps go on from.
void copy_state(const mjModel_* m, const mjData_* d, mjData_* to);
// Kinetic and potential energy of the present state, J. Overwrites what the last step computed.
std::array<double, 2> mechanical_energy(const mjModel_* m, mjData_* d);

}  // namespace dashpot::host
