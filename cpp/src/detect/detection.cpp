#include "dashpot/detect/detection.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <stdexcept>

#include "dashpot/detect/joint_gaps.hpp"
#include "dashpot/model/constraints.hpp"
#include "dashpot/model/contacts.hpp"
#include "dashpot/model/errors.hpp"
#include "dashpot/model/sleep.hpp"
#include "dashpot/model/velocities.hpp"

namespace dashpot::host {

namespace {

constexpr int kContactsAtOnce = 64;  // by a thread

// How fast (m/s) any place on a cylinder may come nearer to a plane, whatever spins about its axis.
double closing_of_shape(const mjModel* m, const mjData* d, int plane, int cylinder,
                        const mjtNum* normal, const double* body_velocity) {
  const int body[2] = {m->geom_bodyid[plane], m->geom_bodyid[cylinder]};
  const mjtNum *centre = d->geom_xpos + 3 * cylinder, *rotation = d->geom_xmat + 9 * cylinder;
  const mjtNum axis[3] = {rotation[2], rotation[5], rotation[8]};
  mjtNum velocity[2][3], turn[3], across[3];
  for (int i = 0; i < 2; ++i)
    velocity_of_point(m, d, body[i], body_velocity + 6 * body[i], centre, velocity[i]);
  const double* const spin = body_velocity + 6 * body[1];
  mju_addScl3(turn, spin, axis, -mju_dot3(spin, axis));
  mju_subFrom3(turn, body_velocity + 6 * body[0]);
  mju_cross(across, normal, turn);
  return mju_norm3(across) * m->geom_rbound[cylinder] + mju_dot3(normal, velocity[0]) -
         mju_dot3(normal, velocity[1]);
}

// Whether a contact of a plane and a cylinder is apart, and stays so in the step, the spin of the
// cylinder about its axis left out. MuJoCo gives two points a third of a turn away on the rim, for
// cylinders that come down flat; rows, which follow what spins along straight lines, would go
// through the plane where the true circle only comes to it.
bool only_spin_brings_near(const mjModel* m, const mjData* d, const ReachBuffers& reach,
                           const ContactInput& input) {
  if (input.gap <= 0.0 || input.is_of_flex()) return false;
  const int plane = input.geom[0], cylinder = input.geom[1];
  if (m->geom_type[plane] != mjGEOM_PLANE || m->geom_type[cylinder] != mjGEOM_CYLINDER)
    return false;
  const auto comes = [&](const double* velocity) {
    return m->opt.timestep *
               closing_of_shape(m, d, plane, cylinder, input.frame.data(), velocity) >=
           input.gap;
  };
  // What a blow in the step may bring nearer is not known here.
  if (reach.least_reach[plane] > 0.0 || reach.least_reach[cylinder] > 0.0) return false;
  return !comes(reach.now.data()) && !comes(reach.later.data());
}

// Lets contacts of what sleeps pass as beyond the margin, or not: MuJoCo makes no rows of them.
void leave_out_sleeping(const mjModel* m, mjData* d, bool out) {
  if (!any_sleeps(m, d)) return;
  for (int i = 0; i < d->ncon; ++i) {
    mjContact& contact = d->contact[i];
    if (contact.exclude != (out ? kIncluded : kInGap)) continue;
    for (int geom : contact.geom)
      if (geom >= 0 && sleeps(d, m->body_treeid[m->geom_bodyid[geom]]))
        contact.exclude = out ? kInGap : kIncluded;
  }
}

// MuJoCo's constraint rows; false where they do not fit into the memory of the model.
bool make_all_rows(const mjModel* m, mjData* d) {
  const int lost = d->warning[mjWARN_CNSTRFULL].number;
  mj_makeConstraint(m, d);
  return d->warning[mjWARN_CNSTRFULL].number == lost;
}

// The same without those of contacts, which pass as beyond the margin meanwhile: the model's own
// flag would be seen by whoever copies the model.
bool make_rows_without_contacts(const mjModel* m, mjData* d) {
  for (int i = 0; i < d->ncon; ++i) {
    mjContact& contact = d->contact[i];
    contact.efc_address = -1;
    if (contact.exclude == kIncluded) contact.exclude = kInGap;
  }
  const bool fit = make_all_rows(m, d);
  for (int i = 0; i < d->ncon; ++i)
    if (d->contact[i].exclude == kInGap) d->contact[i].exclude = kIncluded;
  return fit;
}

bool make_rows(const mjModel* m, mjData* d, ContactRows of_contacts) {
  if (of_contacts == ContactRows::kNone) return make_rows_without_contacts(m, d);
  if (of_contacts == ContactRows::kRequired) return make_all_rows(m, d);
  const size_t arena = d->parena;
  try {
    const ErrorGuard guard(d);
    if (make_all_rows(m, d)) return true;
  } catch (const StackOverflow&) {
    d->ne = d->nf = d->nl = d->nefc = 0;
    d->parena = arena;
  }
  return make_rows_without_contacts(m, d);
}

[[noreturn]] void throw_contacts_exceed_memory() {
  throw std::runtime_error(
      "contacts exceed the memory of the model; enlarge <size memory=\"...\"/>");
}

void collide_candidates(mjModel* m, mjData* d, FaceBuffers* faces, Detection& detection,
                        Team& team) {
  const std::vector<CandidatePair>& near =
      detection.candidates.near(m, d, detection.buffers, detection.narrowing, team);
  detection.narrowphase.find(m, d, near, faces, detection.scratch, team);
  detection.narrowphase.write(m, d, team);
}

// Those that may be loaded in the step, as they are found.
void read_loadable(const mjModel* m, const mjData* d, Detection& detection,
                   std::vector<ContactInput>& contacts, Team& team) {
  contacts.resize(d->ncon);
  detection.may_be_loaded.resize(d->ncon);
  team.for_each(d->ncon, kContactsAtOnce, [&](int i) {
    detection.may_be_loaded[i] =
        read_contact(m, d, i, contacts[i]) &&
        !(detection.looks_ahead && only_spin_brings_near(m, d, detection.buffers, contacts[i]));
  });
  int kept = 0;
  for (int i = 0; i < d->ncon; ++i) {
    if (!detection.may_be_loaded[i]) continue;
    if (kept != i) contacts[kept] = contacts[i];
    ++kept;
  }
  contacts.resize(kept);
}

}  // namespace

void detect_rows(mjModel_* m, mjData_* d, const std::vector<double>& acceleration,
                 Detection& detection, std::vector<ContactInput>& contacts,
                 std::vector<ConstraintInput>& constraints, Team& team) {
  {
    FaceBuffers* const faces = detection.takes_faces ? &detection.faces : nullptr;
    const bool keeps_pairs = CandidatePairs::cover(m, d);
    // Where MuJoCo looks for pairs itself, its collisions ask.
    detection.narrowing.start(detection.buffers);
    WidenedReach reach(m, d, detection.looks_ahead ? &acceleration : nullptr, faces,
                       keeps_pairs ? nullptr : &detection.narrowing, detection.buffers);
    const int lost = d->warning[mjWARN_CONTACTFULL].number;
    detection.faces.surplus.clear();
    if (keeps_pairs)
      collide_candidates(m, d, faces, detection, team);
    else
      call_with_callbacks(mj_collision, m, d);
    const bool contacts_fit = add_surplus(d, detection.faces.surplus);
    int kept = 0;
    for (int i = 0; i < d->ncon; ++i) {
      mjContact& contact = d->contact[i];
      // Here contacts beyond the margin may start in this step.
      if (contact.exclude == kInGap) contact.exclude = kIncluded;
      // Nor do contacts adhere there; force reports take adhesion off the contact's force.
      if (contact.adhesion != 0.0 && !reach.within_own(contact)) contact.adhesion = 0.0;
      if (keeps_its_gap(m, d, contact)) {
        if (!reach.within_own(contact)) continue;
        contact.exclude = kInGap;
      }
      if (kept < i) d->contact[kept] = contact;
      ++kept;
    }
    d->ncon = kept;
    leave_out_sleeping(m, d, true);
    const bool rows_fit = make_rows(m, d, detection.contact_rows);
    if (!contacts_fit || !rows_fit || d->warning[mjWARN_CONTACTFULL].number > lost)
      throw_contacts_exceed_memory();
  }
  leave_out_sleeping(m, d, false);
  read_loadable(m, d, detection, contacts, team);
  leave_out_sleeping(m, d, true);
  drop_ghost_contacts(m, d, detection.buffers.start_reach, detection.faces,
                      detection.internal_edges, contacts);
  read_constraints(m, d, constraints);
  append_dampers(m, d, detection.dampers, constraints);
  d->nisland = 0;  // as where MuJoCo's islands are disabled; they are for its own solvers
  mj_referenceConstraint(m, d);
}

bool anything_reads_rows(const mjModel_* m) {
  return m->nsensor > 0 || m->nplugin > 0 || m->nflex > 0;
}

void detect(mjModel_* m, mjData_* d, const std::vector<double>& acceleration,
            const double* last_displacement, Detection& detection,
            std::vector<ContactInput>& contacts, std::vector<ConstraintInput>& constraints,
            Team& team) {
  detection.buffers.start(m, last_displacement);
  detection.narrowphase.forget();
  detect_rows(m, d, acceleration, detection, contacts, constraints, team);
  call_with_callbacks(mj_sensorPos, m, d);
  call_with_callbacks(mj_sensorVel, m, d);
  if (m->opt.enableflags & mjENBL_ENERGY) {
    mj_energyPos(m, d);
    mj_energyVel(m, d);
  }
}

void find_present_contacts(mjModel_* m, mjData_* d, Detection& detection) {
  const int lost = d->warning[mjWARN_CONTACTFULL].number;
  detection.faces.surplus.clear();
  const ReplacedCollisions collisions(m, detection.takes_faces ? &detection.faces : nullptr,
                                      nullptr);
  call_with_callbacks(mj_collision, m, d);
  if (!add_surplus(d, detection.faces.surplus) || d->warning[mjWARN_CONTACTFULL].number > lost)
    throw_contacts_exceed_memory();
}

MiddleGeometry::MiddleGeometry(mjModel_* m, mjData_* d, const std::vector<double>& acceleration,
                               Detection& detection, std::vector<ContactInput>& contacts,
                               std::vector<ConstraintInput>& constraints, Team& team)
    : start_(m, d) {
  const double half = 0.5 * m->opt.timestep;
  std::vector<double> velocity(d->qvel, d->qvel + m->nv);
  for (int i = 0; i < m->nv; ++i) velocity[i] += 0.5 * half * acceleration[i];
  mj_integratePos(m, d->qpos, velocity.data(), half);
  mj_fwdKinematics(m, d);
  mj_makeM(m, d);
  detection.narrowphase.forget();
  detect_rows(m, d, acceleration, detection, contacts, constraints, team);
  detection.narrowphase.forget();  // for the start is where geoms will be asked for next
}

MiddleGeometry::Start::Start(const mjModel_* m, mjData_* d)
    : model_(m), data_(d), position_(d->qpos, d->qpos + m->nq) {}

MiddleGeometry::Start::~Start() {
  if (restored_) return;
  try {
    const ErrorGuard guard(data_);
    restore();
  } catch (const MujocoError&) {  // what has brought us here is told
  }
}

void MiddleGeometry::Start::restore() {
  restored_ = true;
  std::copy(position_.begin(), position_.end(), data_->qpos);
  mj_fwdKinematics(model_, data_);
  mj_makeM(model_, data_);
}

}  // namespace dashpot::host
