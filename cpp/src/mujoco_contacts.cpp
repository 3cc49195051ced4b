// Detection of contacts and limits. Part of the mujoco_host room.

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "dashpot/mujoco_errors.hpp"
#include "dashpot/mujoco_host.hpp"
#include "dashpot/mujoco_narrowphase.hpp"
#include "dashpot/mujoco_reach.hpp"

namespace dashpot::host {

namespace {

std::array<double, 3> to_local(const mjtNum* position, const mjtNum* rotation,
                               const mjtNum* point) {
  mjtNum arm[3], local[3];
  mju_sub3(arm, point, position);
  mju_mulMatTVec3(local, rotation, arm);
  return {local[0], local[1], local[2]};
}

// The frame that a contact is remembered in on one side: that of its geom; of the other side's geom
// where this one is a flex, which has none; or the world's.
struct Frame {
  const mjtNum* position;
  const mjtNum* rotation;
};
Frame frame_of_side(const mjData* d, const mjContact& contact, int side) {
  for (int geom : {contact.geom[side], contact.geom[1 - side]})
    if (geom >= 0) return {d->geom_xpos + 3 * geom, d->geom_xmat + 9 * geom};
  return {d->xpos, d->xmat};
}

void read_contact(const mjModel* m, const mjData* d, int index, ContactInput& input) {
  const mjContact& contact = d->contact[index];
  input.source = index;
  input.dim = contact.dim;
  input.margin = contact.includemargin;
  input.gap = contact.dist - input.margin;
  std::copy(contact.pos, contact.pos + 3, input.position.begin());
  std::copy(contact.frame, contact.frame + 9, input.frame.begin());
  mju_scl3(input.apart.data(), contact.frame, std::max(0.0, input.gap));
  std::copy(contact.friction, contact.friction + 5, input.friction.begin());
  std::copy_n(contact.solref, 2, input.solref.begin());
  std::copy_n(contact.solimp, input.solimp.size(), input.solimp.begin());
  input.has_solref = !is_default_impedance(contact.solref, contact.solimp);
  for (int side = 0; side < 2; ++side) {
    const int geom = contact.geom[side];
    input.geom[side] = geom < 0 ? -1 - contact.flex[side] : geom;
    if (geom >= 0) input.tree[side] = m->body_treeid[m->geom_bodyid[geom]];
    const Frame frame = frame_of_side(d, contact, side);
    input.local_position[side] = to_local(frame.position, frame.rotation, contact.pos);
  }
  if (input.is_of_flex()) input.tree = trees_of_row(m, d, contact.efc_address);
  const mjtNum* rotation = frame_of_side(d, contact, 0).rotation;
  std::copy(rotation, rotation + 9, input.rotation.begin());
}

// Whether no joint moves the two sides of a contact against each other: those of one body or of
// bodies welded to it, or both of the world and of mocap bodies. MuJoCo makes no rows of them.
bool moves_nothing(const mjModel* m, const mjContact& contact, const ContactInput& input) {
  if (input.tree == std::array<int, 2>{-1, -1}) return true;
  const int first = contact.geom[0], second = contact.geom[1];
  return first >= 0 && second >= 0 &&
         m->body_weldid[m->geom_bodyid[first]] == m->body_weldid[m->geom_bodyid[second]];
}

// The last degree of freedom that moves a geom against the world, -1 for none.
int last_dof(const mjModel* m, int geom) {
  const int body = m->body_weldid[m->geom_bodyid[geom]];
  return m->body_dofnum[body] == 0 ? -1 : m->body_dofadr[body] + m->body_dofnum[body] - 1;
}

// Whether a single joint moves two geoms that are apart against each other and keeps their contact
// as it is, along a line across its normal or about it, like links that face each other across the
// axis between them: it cannot be loaded.
bool keeps_its_gap(const mjModel* m, const mjData* d, const ContactInput& input) {
  if (input.gap < 0.0 || input.is_of_flex()) return false;
  const int dof1 = last_dof(m, input.geom[0]), dof2 = last_dof(m, input.geom[1]);
  const auto follows = [&](int dof, int parent) {
    return dof >= 0 && m->dof_parentid[dof] == parent;
  };
  if (!follows(dof1, dof2) && !follows(dof2, dof1)) return false;
  const int dof = follows(dof1, dof2) ? dof1 : dof2;
  const mjtNum *axis = d->cdof + 6 * dof, *normal = input.frame.data(),
               *centre = d->subtree_com + 3 * m->body_rootid[m->dof_bodyid[dof]];
  mjtNum arm[3], velocity[3], off_axis[3];
  mju_cross(off_axis, normal, axis);
  if (mju_norm3(off_axis) > kDirection * mju_norm3(axis)) return false;
  mju_sub3(arm, input.position.data(), centre);
  mju_cross(velocity, axis, arm);
  mju_addTo3(velocity, axis + 3);
  return std::abs(mju_dot3(normal, velocity)) < kDirection * mju_norm3(velocity);
}

// Values of mjContact::exclude. MuJoCo leaves contacts beyond the margin out of its rows.
constexpr int kIncluded = 0, kInGap = 1;

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

void collide_candidates(mjModel* m, mjData* d, Detection& detection) {
  Narrowphase& narrowphase = detection.narrowphase;
  narrowphase.find(m, d, detection.candidates.near(m, d, detection.buffers.reach));
  narrowphase.write(m, d);
}

void detect_rows(mjModel* m, mjData* d, const std::vector<double>& acceleration,
                 Detection& detection, std::vector<ContactInput>& contacts,
                 std::vector<ConstraintInput>& constraints) {
  {
    FaceBuffers* const faces = detection.takes_faces ? &detection.faces : nullptr;
    WidenedReach reach(m, d, acceleration, faces, detection.buffers);
    const int lost = d->warning[mjWARN_CONTACTFULL].number;
    detection.faces.surplus.clear();
    if (CandidatePairs::cover(m, d))
      collide_candidates(m, d, detection);
    else
      call_with_callbacks(mj_collision, m, d);
    const bool contacts_fit = add_surplus(d, detection.faces.surplus);
    for (int i = 0; i < d->ncon; ++i) {
      mjContact& contact = d->contact[i];
      // Here contacts beyond the margin may start in this step.
      if (contact.exclude == kInGap) contact.exclude = kIncluded;
      // Nor do contacts adhere there; force reports take adhesion off the contact's force.
      if (contact.adhesion != 0.0 && !reach.within_own(contact)) contact.adhesion = 0.0;
    }
    const bool rows_fit = make_rows(m, d, detection.contact_rows);
    if (!contacts_fit || !rows_fit || d->warning[mjWARN_CONTACTFULL].number > lost)
      throw std::runtime_error(
          "contacts exceed the memory of the model; enlarge <size memory=\"...\"/>");
  }
  read_contacts(m, d, contacts);
  contacts.erase(
      std::remove_if(contacts.begin(), contacts.end(),
                     [&](const ContactInput& contact) { return keeps_its_gap(m, d, contact); }),
      contacts.end());
  drop_contacts_at_seams(m, d, detection.buffers.start_reach, detection.faces, detection.seams,
                         contacts);
  read_constraints(m, d, constraints);
  d->nisland = 0;  // as where MuJoCo's islands are disabled; they are for its own solvers
  mj_referenceConstraint(m, d);
}

}  // namespace

bool anything_reads_rows(const mjModel_* m) {
  return m->nsensor > 0 || m->nplugin > 0 || m->nflex > 0;
}

void detect(mjModel_* m, mjData_* d, const std::vector<double>& acceleration, Detection& detection,
            std::vector<ContactInput>& contacts, std::vector<ConstraintInput>& constraints) {
  detection.buffers.forget_least();
  detection.narrowphase.forget();
  detection.faces.body_velocity = nullptr;
  detect_rows(m, d, acceleration, detection, contacts, constraints);
  call_with_callbacks(mj_sensorPos, m, d);
  call_with_callbacks(mj_sensorVel, m, d);
  if (m->opt.enableflags & mjENBL_ENERGY) {
    mj_energyPos(m, d);
    mj_energyVel(m, d);
  }
}

void detect_again(mjModel_* m, mjData_* d, const std::vector<double>& acceleration,
                  const std::vector<double>& body_velocity, Detection& detection,
                  std::vector<ContactInput>& contacts, std::vector<ConstraintInput>& constraints) {
  detection.faces.body_velocity = body_velocity.data();
  detect_rows(m, d, acceleration, detection, contacts, constraints);
}

MiddleGeometry::MiddleGeometry(mjModel_* m, mjData_* d, const std::vector<double>& acceleration,
                               Detection& detection, std::vector<ContactInput>& contacts,
                               std::vector<ConstraintInput>& constraints)
    : start_(m, d) {
  const double half = 0.5 * m->opt.timestep;
  std::vector<double> velocity(d->qvel, d->qvel + m->nv);
  for (int i = 0; i < m->nv; ++i) velocity[i] += 0.5 * half * acceleration[i];
  mj_integratePos(m, d->qpos, velocity.data(), half);
  mj_fwdKinematics(m, d);
  mj_makeM(m, d);
  detection.narrowphase.forget();
  detect_rows(m, d, acceleration, detection, contacts, constraints);
  detection.narrowphase.forget();  // for the start is where geoms will be asked for next
}

MiddleGeometry::Start::Start(const mjModel_* m, mjData_* d)
    : model_(m), data_(d), position_(d->qpos, d->qpos + m->nq) {}

MiddleGeometry::Start::~Start() {
  std::copy(position_.begin(), position_.end(), data_->qpos);
  mj_fwdKinematics(model_, data_);
  mj_makeM(model_, data_);
}

void read_contacts(const mjModel_* m, const mjData_* d, std::vector<ContactInput>& contacts) {
  contacts.clear();
  for (int i = 0; i < d->ncon; ++i) {
    const mjContact& contact = d->contact[i];
    // Contacts of flexes are read from MuJoCo's rows.
    const bool geoms = contact.geom[0] >= 0 && contact.geom[1] >= 0;
    if (contact.exclude != kIncluded || !(geoms || contact.efc_address >= 0)) continue;
    contacts.emplace_back();
    read_contact(m, d, i, contacts.back());
    if (moves_nothing(m, contact, contacts.back())) contacts.pop_back();
  }
}

bool make_room_for_contacts(mjData_* d, int count) {
  if (count == 0) return true;
  const size_t size = sizeof(mjContact) * (d->ncon + count);
  if (size > d->narena - d->pstack) return false;
  d->parena = size;
  d->maxuse_arena = std::max<mjtSize>(d->maxuse_arena, d->pstack + d->parena);
  d->ncon += count;
  d->maxuse_con = std::max(d->maxuse_con, d->ncon);
  return true;
}

void set_frame(const double* normal, double* frame) {
  const double tangent[3] = {0.0, 0.0, 0.0};
  set_frame(normal, tangent, frame);
}

// As MuJoCo does.
void set_frame(const double* normal, const double* tangent, double* frame) {
  mju_copy3(frame, normal);
  mju_copy3(frame + 3, tangent);
  mju_normalize3(frame);
  if (mju_dot3(tangent, tangent) < 0.25) {
    mju_zero3(frame + 3);
    frame[std::abs(frame[1]) < 0.5 ? 4 : 5] = 1.0;
  }
  mju_addToScl3(frame + 3, frame, -mju_dot3(frame + 3, frame));
  mju_normalize3(frame + 3);
  mju_cross(frame + 6, frame, frame + 3);
}

void redirect_contact(mjData_* d, const double* position, const double* normal, double gap,
                      ContactInput& input) {
  mjContact& contact = d->contact[input.source];
  input.gap = gap;
  contact.dist = gap + input.margin;
  mju_copy3(contact.pos, position);
  set_frame(normal, contact.frame);
  std::copy(contact.pos, contact.pos + 3, input.position.begin());
  std::copy(contact.frame, contact.frame + 9, input.frame.begin());
}

int detected_count(const mjData_* d) { return d->ncon; }

std::array<double, 6> contact_force(const mjModel_* m, const mjData_* d, int index) {
  if (d->contact[index].efc_address < 0)
    throw std::runtime_error(
        "data hold no forces of their contacts: MuJoCo's rows did not fit into the memory of the "
        "model in the last step (enlarge <size memory=\"...\"/>), or it did not end");
  std::array<double, 6> wrench{};
  mj_contactForce(m, d, index, wrench.data());
  return wrench;
}

}  // namespace dashpot::host
