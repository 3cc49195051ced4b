// Detection of contacts with a reach that covers the step, and their rows. Part of the mujoco_host
// room.

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "dashpot/mujoco_host.hpp"

// Exported by the pinned MuJoCo library though not declared in its public headers: the collision of
// any two convex geoms.
extern "C" int mjc_Convex(const mjModel* m, mjData* d, mjPreContact* con, int g1, int g2,
                          mjtNum margin);

namespace dashpot::host {

namespace {

constexpr int kBodyRows = 6;  // coordinates of a free body that are not zero

// Part of a box's least half-width: a wider reach needs contacts of boxes that meet at a corner.
constexpr double kFarReach = 0.005;

thread_local bool reach_is_widened = false;
mjfCollision collide_boxes = nullptr;

// MuJoCo's own collision of boxes, which finds nothing between boxes that are apart and face each
// other with corners or edges. Under a widened reach such contacts may start in this step.
int collide_boxes_apart(const mjModel* m, mjData* d, mjPreContact* contact, int geom1, int geom2,
                        mjtNum margin) {
  const int count = collide_boxes(m, d, contact, geom1, geom2, margin);
  if (count > 0 || !reach_is_widened) return count;
  double half_width = mjMAXVAL;
  for (int geom : {geom1, geom2})
    for (int i = 0; i < 3; ++i) half_width = std::min(half_width, m->geom_size[3 * geom + i]);
  if (margin <= kFarReach * half_width) return 0;
  return mjc_Convex(m, d, contact, geom1, geom2, margin);
}

// Once in a process; collisions outside detect() stay as they are.
void install_collision_of_boxes() {
  static const bool installed = [] {
    mjfCollision& entry = mjCOLLISIONFUNC[mjGEOM_BOX][mjGEOM_BOX];
    collide_boxes = entry;
    entry = collide_boxes_apart;
    return true;
  }();
  static_cast<void>(installed);
}

double norm3(const mjtNum* v) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

// Largest speed of any point of a body within `radius` of `point`.
double speed_about(const mjModel* m, const mjData* d, int body, const mjtNum* point, double radius,
                   const double* body_velocity) {
  const double* v = body_velocity + 6 * body;
  const mjtNum* com = d->subtree_com + 3 * m->body_rootid[body];
  mjtNum arm[3], at_point[3];
  mju_sub3(arm, point, com);
  mju_cross(at_point, v, arm);
  mju_addTo3(at_point, v + 3);
  return norm3(at_point) + norm3(v) * radius;
}

double geom_speed(const mjModel* m, const mjData* d, int geom, const double* body_velocity) {
  return speed_about(m, d, m->geom_bodyid[geom], d->geom_xpos + 3 * geom, m->geom_rbound[geom],
                     body_velocity);
}

// Largest speed of the vertices of a flex, or of the nodes that carry them.
double flex_speed(const mjModel* m, const mjData* d, int flex, const double* body_velocity) {
  const bool nodes = m->flex_interp[flex];
  const int begin = nodes ? m->flex_nodeadr[flex] : m->flex_vertadr[flex];
  const int count = nodes ? m->flex_nodenum[flex] : m->flex_vertnum[flex];
  double speed = 0.0;
  for (int i = begin; i < begin + count; ++i) {
    const int body = nodes ? m->flex_nodebodyid[i] : m->flex_vertbodyid[i];
    const double radius = norm3(nodes ? m->flex_node + 3 * i : m->flex_vert + 3 * i);
    speed = std::max(speed, speed_about(m, d, body, d->xpos + 3 * body, radius, body_velocity));
  }
  return speed;
}

// Widens the detection distance of every geom and limit by how far it can move in this step.
class WidenedReach {
 public:
  WidenedReach(mjModel* m, const mjData* d, const std::vector<double>& acceleration)
      : m_(m),
        geom_gap_(m->geom_gap, m->geom_gap + m->ngeom),
        body_margin_(m->body_margin, m->body_margin + m->nbody),
        pair_gap_(m->pair_gap, m->pair_gap + m->npair),
        flex_gap_(m->flex_gap, m->flex_gap + m->nflex),
        joint_margin_(m->jnt_margin, m->jnt_margin + m->njnt),
        tendon_margin_(m->tendon_margin, m->tendon_margin + m->ntendon) {
    install_collision_of_boxes();
    reach_is_widened = true;
    const double h = m->opt.timestep;
    std::vector<double> now, later, end_velocity(m->nv);
    for (int i = 0; i < m->nv; ++i) end_velocity[i] = d->qvel[i] + h * acceleration[i];
    body_velocities(m, d, d->qvel, now);
    body_velocities(m, d, end_velocity.data(), later);
    std::vector<double> reach(m->ngeom, 0.0);
    for (int geom = 0; geom < m->ngeom; ++geom) {
      if (m->body_treeid[m->geom_bodyid[geom]] < 0) continue;
      reach[geom] =
          h * std::max(geom_speed(m, d, geom, now.data()), geom_speed(m, d, geom, later.data()));
      m->geom_gap[geom] = std::max(geom_gap_[geom], reach[geom]);
      // The broadphase goes by the largest of a body's geoms.
      mjtNum& margin = m->body_margin[m->geom_bodyid[geom]];
      margin = std::max(margin, m->geom_margin[geom] + m->geom_gap[geom]);
    }
    for (int pair = 0; pair < m->npair; ++pair)
      m->pair_gap[pair] =
          std::max(pair_gap_[pair], reach[m->pair_geom1[pair]] + reach[m->pair_geom2[pair]]);

    for (int flex = 0; flex < m->nflex; ++flex)
      m->flex_gap[flex] = std::max(
          flex_gap_[flex],
          h * std::max(flex_speed(m, d, flex, now.data()), flex_speed(m, d, flex, later.data())));

    const auto dof_reach = [&](int dof) {
      return h * std::max(std::abs(d->qvel[dof]), std::abs(end_velocity[dof]));
    };
    for (int joint = 0; joint < m->njnt; ++joint) {
      // A ball joint's angle changes no faster than its angular velocity.
      const int dofs = m->jnt_type[joint] == mjJNT_BALL ? 3 : 1;
      for (int i = 0; i < dofs; ++i) m->jnt_margin[joint] += dof_reach(m->jnt_dofadr[joint] + i);
    }
    for (int tendon = 0; tendon < m->ntendon; ++tendon)
      for (int k = m->ten_J_rowadr[tendon]; k < m->ten_J_rowadr[tendon] + m->ten_J_rownnz[tendon];
           ++k)
        m->tendon_margin[tendon] += std::abs(d->ten_J[k]) * dof_reach(m->ten_J_colind[k]);
  }
  ~WidenedReach() {
    reach_is_widened = false;
    std::copy(geom_gap_.begin(), geom_gap_.end(), m_->geom_gap);
    std::copy(body_margin_.begin(), body_margin_.end(), m_->body_margin);
    std::copy(pair_gap_.begin(), pair_gap_.end(), m_->pair_gap);
    std::copy(flex_gap_.begin(), flex_gap_.end(), m_->flex_gap);
    std::copy(joint_margin_.begin(), joint_margin_.end(), m_->jnt_margin);
    std::copy(tendon_margin_.begin(), tendon_margin_.end(), m_->tendon_margin);
  }
  // Whether MuJoCo would have found a contact without the wider reach.
  bool within_own(const mjContact& contact) const {
    const int first = contact.geom[0], second = contact.geom[1];
    const auto own_gap = [&](int side) {
      return contact.geom[side] < 0 ? flex_gap_[contact.flex[side]] : geom_gap_[contact.geom[side]];
    };
    double gap = own_gap(0) + own_gap(1);
    for (int pair = 0; pair < m_->npair; ++pair)
      if (std::minmax(m_->pair_geom1[pair], m_->pair_geom2[pair]) == std::minmax(first, second))
        gap = pair_gap_[pair];
    return contact.dist < contact.includemargin + gap;
  }
  WidenedReach(const WidenedReach&) = delete;
  WidenedReach& operator=(const WidenedReach&) = delete;

 private:
  mjModel* m_;
  std::vector<mjtNum> geom_gap_, body_margin_, pair_gap_, flex_gap_, joint_margin_, tendon_margin_;
};

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

ContactInput read_contact(const mjModel* m, const mjData* d, int index) {
  const mjContact& contact = d->contact[index];
  ContactInput input;
  input.source = index;
  input.dim = contact.dim;
  input.gap = contact.dist - contact.includemargin;
  std::copy(contact.pos, contact.pos + 3, input.position.begin());
  std::copy(contact.frame, contact.frame + 9, input.frame.begin());
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
  if (contact.geom[0] < 0 || contact.geom[1] < 0)
    input.tree = trees_of_row(m, d, contact.efc_address);
  const mjtNum* rotation = frame_of_side(d, contact, 0).rotation;
  std::copy(rotation, rotation + 9, input.rotation.begin());
  return input;
}

bool has_flex(const ContactInput& input) { return input.geom[0] < 0 || input.geom[1] < 0; }

bool has_surface_motion(const mjModel* m, const ContactInput& input) {
  for (int geom : input.geom)
    if (geom >= 0)
      for (int i = 0; i < 6; ++i)
        if (m->geom_surfacevel[6 * geom + i] != 0.0) return true;
  return false;
}

// What the surfaces of the geoms, moving by themselves, add to the rates of a contact's rows: to
// sliding and spin, as in MuJoCo; not to the gap, nor to rolling.
std::array<double, 6> surface_motion(const mjModel* m, const mjData* d, const ContactInput& input) {
  mjtNum linear[3] = {}, angular[3] = {};
  for (int side = 0; side < 2; ++side) {
    const int geom = input.geom[side];
    if (geom < 0) continue;
    const mjtNum* own = m->geom_surfacevel + 6 * geom;
    const mjtNum* rotation = d->geom_xmat + 9 * geom;
    mjtNum v[3], w[3], arm[3], around[3];
    mju_mulMatVec3(v, rotation, own);
    mju_mulMatVec3(w, rotation, own + 3);
    mju_sub3(arm, input.position.data(), d->geom_xpos + 3 * geom);
    mju_cross(around, w, arm);
    mju_addTo3(v, around);
    mju_addToScl3(linear, v, side ? 1.0 : -1.0);
    mju_addToScl3(angular, w, side ? 1.0 : -1.0);
  }
  const double* frame = input.frame.data();
  return {
      0.0, mju_dot3(frame + 3, linear), mju_dot3(frame + 6, linear), mju_dot3(frame, angular), 0.0,
      0.0};
}

// Last degree of freedom that moves a body, -1 if none does.
int last_dof(const mjModel* m, int body) {
  while (body > 0 && m->body_dofnum[body] == 0) body = m->body_parentid[body];
  return body > 0 ? m->body_dofadr[body] + m->body_dofnum[body] - 1 : -1;
}

// Appends the coordinates of a tree that move either geom of a contact; returns how many.
int append_columns(const mjModel* m, const ContactInput& input, const Tree& t, int tree,
                   Rows& rows) {
  const size_t before = rows.column.size();
  if (t.free_body) {
    for (int i : {0, 1, 2, 4, 5, 6}) rows.column.push_back(t.begin + i);
    return kBodyRows;
  }
  // Both chains from the leaves down, merged; each descends strictly.
  int dof[2] = {-1, -1};
  for (int side = 0; side < 2; ++side)
    if (input.tree[side] == tree) dof[side] = last_dof(m, m->geom_bodyid[input.geom[side]]);
  while (dof[0] >= 0 || dof[1] >= 0) {
    const int next = std::max(dof[0], dof[1]);
    rows.column.push_back(t.begin + next - t.dof_begin);
    for (int& end : dof)
      if (end == next) end = m->dof_parentid[end];
  }
  std::reverse(rows.column.begin() + before, rows.column.end());
  return static_cast<int>(rows.column.size() - before);
}

// Adds what the body on one side contributes to the sparse rows of a contact.
void add_side(const mjModel* m, const mjData* d, const ContactInput& input, int side,
              const PairGeometry& pair, const Trees& trees, const RowGroup& c, Rows& rows) {
  const int block = c.tree[0] == input.tree[side] ? 0 : 1;
  const Tree& t = trees.tree[input.tree[side]];
  const int first = block == 0 ? 0 : c.columns[0];
  const int* column = rows.column.data() + c.column + first;
  double* value = rows.value.data() + c.value + first;
  if (t.free_body) {
    for (int i = 0; i < c.dim; ++i) {
      const std::array<double, 6> row = pair_row(pair, i, side);
      for (int k = 0; k < kBodyRows; ++k) value[i * c.width() + k] = row[k];
    }
    return;
  }
  const double* frame = input.frame.data();
  const double sign = side ? 1.0 : -1.0;
  const int body = m->geom_bodyid[input.geom[side]];
  mjtNum arm[3];
  mju_sub3(arm, input.position.data(), d->subtree_com + 3 * m->body_rootid[body]);
  int k = c.columns[block] - 1;
  for (int dof = last_dof(m, body); dof >= 0; dof = m->dof_parentid[dof]) {
    while (column[k] != t.begin + dof - t.dof_begin) --k;
    const mjtNum* axis = d->cdof + 6 * dof;
    mjtNum linear[3];
    mju_cross(linear, axis, arm);
    mju_addTo3(linear, axis + 3);
    for (int i = 0; i < c.dim; ++i)
      value[i * c.width() + k] +=
          sign * (i < 3 ? mju_dot3(frame + 3 * i, linear) : mju_dot3(frame + 3 * (i - 3), axis));
  }
}

}  // namespace

void body_velocities(const mjModel* m, const mjData* d, const double* qvel,
                     std::vector<double>& velocity) {
  velocity.assign(6 * m->nbody, 0.0);
  for (int body = 1; body < m->nbody; ++body) {
    double* v = velocity.data() + 6 * body;
    const double* parent = velocity.data() + 6 * m->body_parentid[body];
    std::copy(parent, parent + 6, v);
    for (int j = m->body_dofadr[body]; j < m->body_dofadr[body] + m->body_dofnum[body]; ++j)
      for (int i = 0; i < 6; ++i) v[i] += d->cdof[6 * j + i] * qvel[j];
  }
}

namespace {

void detect_rows(mjModel* m, mjData* d, const std::vector<double>& acceleration,
                 std::vector<ContactInput>& contacts, std::vector<ConstraintInput>& constraints) {
  {
    WidenedReach reach(m, d, acceleration);
    const int lost = d->warning[mjWARN_CONTACTFULL].number + d->warning[mjWARN_CNSTRFULL].number;
    mj_collision(m, d);
    for (int i = 0; i < d->ncon; ++i) {
      mjContact& contact = d->contact[i];
      // MuJoCo leaves contacts beyond the margin out of its rows; here they may start in this step.
      if (contact.exclude == 1) contact.exclude = 0;
      // Nor do contacts adhere there; force reports take adhesion off the contact's force.
      if (contact.adhesion != 0.0 && !reach.within_own(contact)) contact.adhesion = 0.0;
    }
    mj_makeConstraint(m, d);
    if (d->warning[mjWARN_CONTACTFULL].number + d->warning[mjWARN_CNSTRFULL].number > lost)
      throw std::runtime_error(
          "contacts exceed the memory of the model; enlarge <size memory=\"...\"/>");
  }
  read_contacts(m, d, contacts);
  read_constraints(m, d, constraints);
  d->nisland = 0;  // as where MuJoCo's islands are disabled; they are for its own solvers
  mj_referenceConstraint(m, d);
}

}  // namespace

void detect(mjModel_* m, mjData_* d, const std::vector<double>& acceleration,
            std::vector<ContactInput>& contacts, std::vector<ConstraintInput>& constraints) {
  detect_rows(m, d, acceleration, contacts, constraints);
  mj_sensorPos(m, d);
  mj_sensorVel(m, d);
  if (m->opt.enableflags & mjENBL_ENERGY) {
    mj_energyPos(m, d);
    mj_energyVel(m, d);
  }
}

MiddleGeometry::MiddleGeometry(mjModel_* m, mjData_* d, const std::vector<double>& acceleration,
                               std::vector<ContactInput>& contacts,
                               std::vector<ConstraintInput>& constraints)
    : model_(m), data_(d), start_(d->qpos, d->qpos + m->nq) {
  const double half = 0.5 * m->opt.timestep;
  std::vector<double> velocity(d->qvel, d->qvel + m->nv);
  for (int i = 0; i < m->nv; ++i) velocity[i] += 0.5 * half * acceleration[i];
  mj_integratePos(m, d->qpos, velocity.data(), half);
  mj_fwdKinematics(m, d);
  mj_makeM(m, d);
  detect_rows(m, d, acceleration, contacts, constraints);
}

MiddleGeometry::~MiddleGeometry() {
  std::copy(start_.begin(), start_.end(), data_->qpos);
  mj_fwdKinematics(model_, data_);
  mj_makeM(model_, data_);
}

void read_contacts(const mjModel_* m, const mjData_* d, std::vector<ContactInput>& contacts) {
  contacts.clear();
  for (int i = 0; i < d->ncon; ++i) {
    const mjContact& contact = d->contact[i];
    // Contacts of flexes are read from MuJoCo's rows.
    const bool geoms = contact.geom[0] >= 0 && contact.geom[1] >= 0;
    if (contact.exclude == 0 && (geoms || contact.efc_address >= 0))
      contacts.push_back(read_contact(m, d, i));
  }
}

int detected_count(const mjData_* d) { return d->ncon; }

std::array<double, 6> contact_force(const mjModel_* m, const mjData_* d, int index) {
  std::array<double, 6> wrench{};
  mj_contactForce(m, d, index, wrench.data());
  return wrench;
}

std::array<double, 3> contact_velocity(const mjModel_* m, const mjData_* d,
                                       const ContactInput& input) {
  if (has_flex(input)) {
    const mjtNum* rate = d->efc_vel + d->contact[input.source].efc_address;
    return {rate[0], input.dim > 1 ? rate[1] : 0.0, input.dim > 1 ? rate[2] : 0.0};
  }
  mjtNum relative[3] = {0, 0, 0};
  for (int side = 0; side < 2; ++side) {
    const int body = m->geom_bodyid[input.geom[side]];
    const mjtNum* v = d->cvel + 6 * body;
    mjtNum arm[3], velocity[3];
    mju_sub3(arm, input.position.data(), d->subtree_com + 3 * m->body_rootid[body]);
    mju_cross(velocity, v, arm);
    mju_addTo3(velocity, v + 3);
    mju_addToScl3(relative, velocity, side ? 1.0 : -1.0);
  }
  std::array<double, 3> result;
  mju_mulMatVec3(result.data(), input.frame.data(), relative);
  if (!has_surface_motion(m, input)) return result;
  const std::array<double, 6> surface_rate = surface_motion(m, d, input);
  for (int i = 1; i < 3; ++i) result[i] += surface_rate[i];
  return result;
}

void append_jacobian(const mjModel_* m, const mjData_* d, const ContactInput& input,
                     const Trees& trees, Rows& rows) {
  RowGroup& c = rows.group.back();
  const bool driven = has_surface_motion(m, input);
  std::array<double, 6> surface_rate{};
  if (driven) surface_rate = surface_motion(m, d, input);
  if (has_flex(input)) {
    append_rows(m, d, d->contact[input.source].efc_address, trees, rows);
    if (driven) append_surface_motion(rows, surface_rate.data());
    return;
  }
  PairGeometry pair;
  pair.frame = input.frame;
  bool is_pair = !driven;
  for (int side = 0; side < 2; ++side) {
    const int tree = input.tree[side];
    if (tree < 0) continue;
    is_pair = is_pair && trees.tree[tree].free_body && input.tree[0] != input.tree[1];
    pair.begin[side] = trees.tree[tree].begin;
    const mjtNum* centre = d->xipos + 3 * m->geom_bodyid[input.geom[side]];
    for (int i = 0; i < 3; ++i) pair.arm[side][i] = input.position[i] - centre[i];
  }
  if (is_pair) {
    c.pair = static_cast<int>(rows.pair.size());
    rows.pair.push_back(pair);
    return;
  }
  for (int block = 0; block < 2; ++block)
    if (c.tree[block] >= 0)
      c.columns[block] = append_columns(m, input, trees.tree[c.tree[block]], c.tree[block], rows);
  rows.value.resize(c.value + c.dim * c.width(), 0.0);
  for (int side = 0; side < 2; ++side)
    if (input.tree[side] >= 0) add_side(m, d, input, side, pair, trees, c, rows);
  if (driven) append_surface_motion(rows, surface_rate.data());
}

void typical_inverse_mass(const mjData_* d, const ContactInput& input, double* typical) {
  const int address = d->contact[input.source].efc_address;
  for (int i = 0; i < input.dim; ++i) typical[i] = address < 0 ? 0.0 : d->efc_diagA[address + i];
}

}  // namespace dashpot::host
