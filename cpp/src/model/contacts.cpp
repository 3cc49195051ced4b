// Parameters go by MuJoCo's rules (its documentation): an explicit <pair> says everything; else
// the geom of the higher priority; else the larger friction and condim count, a solref with a
// negative number is taken element by element from the lower one, and solref and solimp are
// otherwise averaged with the weights solmix.

#include "dashpot/model/contacts.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "dashpot/model/constraints.hpp"
#include "dashpot/model/jacobians.hpp"

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

void read_included(const mjModel* m, const mjData* d, int index, ContactInput& input) {
  const mjContact& contact = d->contact[index];
  input = {};
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

bool is_of_contact(int row_type) {
  return row_type == mjCNSTR_CONTACT_FRICTIONLESS || row_type == mjCNSTR_CONTACT_PYRAMIDAL ||
         row_type == mjCNSTR_CONTACT_ELLIPTIC;
}

// Whether no joint moves the two sides of a contact against each other: those of one body or of
// bodies welded to it, or both of the world and of mocap bodies. MuJoCo makes no rows of them.
bool moves_nothing(const mjModel* m, const mjContact& contact, const ContactInput& input) {
  if (input.tree[0] < 0 && input.tree[1] < 0) return true;
  const int first = contact.geom[0], second = contact.geom[1];
  return first >= 0 && second >= 0 &&
         m->body_weldid[m->geom_bodyid[first]] == m->body_weldid[m->geom_bodyid[second]];
}

template <size_t N>
std::array<double, N> numbers(const mjtNum* from) {
  std::array<double, N> result;
  std::copy_n(from, N, result.begin());
  return result;
}

ContactParameters of_geom(const mjModel* m, int geom) {
  const mjtNum* f = m->geom_friction + 3 * geom;
  return {m->geom_condim[geom],
          {f[0], f[0], f[1], f[2], f[2]},
          numbers<2>(m->geom_solref + mjNREF * geom),
          {},
          numbers<5>(m->geom_solimp + mjNIMP * geom)};
}

// Share of the first of two geoms in what solmix averages.
double share_of_first(double first, double second) {
  const bool has_first = first >= mjMINVAL, has_second = second >= mjMINVAL;
  if (has_first && has_second) return first / (first + second);
  return has_first == has_second ? 0.5 : has_first ? 1.0 : 0.0;
}

ContactParameters mixed(const ContactParameters& a, const ContactParameters& b, double share) {
  const auto mean = [&](double x, double y) { return share * x + (1.0 - share) * y; };
  // What is no number is not passed over: it is an error where it comes to be used.
  const auto lower = [](double x, double y) { return x < y || std::isnan(x) ? x : y; };
  ContactParameters result = a;
  result.dim = std::max(a.dim, b.dim);
  for (size_t i = 0; i < result.friction.size(); ++i)
    result.friction[i] = std::max(a.friction[i], b.friction[i]);
  const bool both_times = a.solref[0] > 0.0 && b.solref[0] > 0.0;
  for (size_t i = 0; i < result.solref.size(); ++i)
    result.solref[i] =
        both_times ? mean(a.solref[i], b.solref[i]) : lower(a.solref[i], b.solref[i]);
  for (size_t i = 0; i < result.solimp.size(); ++i)
    result.solimp[i] = mean(a.solimp[i], b.solimp[i]);
  return result;
}

// MuJoCo lets no coefficient of friction be less.
ContactParameters with_least_friction(ContactParameters parameters) {
  for (double& coefficient : parameters.friction) coefficient = std::max(coefficient, mjMINMU);
  return parameters;
}

ContactParameters parameters_of(const mjModel* m, int geom1, int geom2) {
  const int pair = defining_pair(m, geom1, geom2);
  return pair >= 0 ? parameters_of_pair(m, pair) : parameters_of_geoms(m, geom1, geom2);
}

}  // namespace

bool read_contact(const mjModel_* m, const mjData_* d, int index, ContactInput& input) {
  const mjContact& contact = d->contact[index];
  // Contacts of flexes are read from MuJoCo's rows.
  const bool geoms = contact.geom[0] >= 0 && contact.geom[1] >= 0;
  if (contact.exclude != kIncluded || !(geoms || contact.efc_address >= 0)) return false;
  read_included(m, d, index, input);
  return !moves_nothing(m, contact, input);
}

void read_contacts(const mjModel_* m, const mjData_* d, std::vector<ContactInput>& contacts) {
  contacts.clear();
  for (int i = 0; i < d->ncon; ++i) {
    contacts.emplace_back();
    if (!read_contact(m, d, i, contacts.back())) contacts.pop_back();
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

// As MuJoCo does, call by call: where processors fuse (ARM), its library is compiled to, so that
// mju_addToScl3() would give other bits.
void set_frame(const double* normal, const double* tangent, double* frame) {
  mju_copy3(frame, normal);
  mju_copy3(frame + 3, tangent);
  mju_normalize3(frame);
  if (mju_dot3(tangent, tangent) < 0.25) {
    mju_zero3(frame + 3);
    frame[std::abs(frame[1]) < 0.5 ? 4 : 5] = 1.0;
  }
  double along[3];
  mju_scl3(along, frame, mju_dot3(frame, frame + 3));
  mju_subFrom3(frame + 3, along);
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

bool leave_out_untouched(const mjModel_* m, mjData_* d, const std::vector<char>& touched,
                         std::vector<ContactInput>& contacts) {
  thread_local std::vector<int> place;  // kept by the thread: no allocation in a step
  thread_local std::vector<mjContact> left_out;
  place.resize(d->ncon);
  left_out.clear();
  const GapArrays own{m->geom_gap, m->pair_gap, m->flex_gap};
  int kept = 0;
  for (int i = 0; i < d->ncon; ++i) {
    mjContact& contact = d->contact[i];
    const bool beyond = !touched[i] && contact.dist >= contact.includemargin;
    if (beyond && contact.dist >= contact.includemargin + gap_of(m, contact, own)) {
      left_out.push_back(contact);
      place[i] = -static_cast<int>(left_out.size());
      continue;
    }
    if (beyond && contact.adhesion == 0.0) contact.exclude = kInGap;
    place[i] = kept;
    if (kept < i) d->contact[kept] = contact;
    ++kept;
  }
  if (left_out.empty()) return false;
  std::copy(left_out.begin(), left_out.end(), d->contact + kept);
  const auto new_place = [&](int i) { return place[i] < 0 ? kept - 1 - place[i] : place[i]; };
  for (int row = d->ne + d->nf + d->nl; row < d->nefc; ++row) {
    if (!is_of_contact(d->efc_type[row])) continue;
    d->efc_id[row] = new_place(d->efc_id[row]);
    // Copies of the data have no such contact: of this type nothing looks for it.
    if (d->efc_id[row] >= kept) d->efc_type[row] = mjCNSTR_CONTACT_FRICTIONLESS;
  }
  for (ContactInput& input : contacts) input.source = new_place(input.source);
  d->ncon = kept;
  return true;
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

int defining_pair(const mjModel_* m, int geom1, int geom2) {
  for (int pair = 0; pair < m->npair; ++pair)
    if (std::minmax(m->pair_geom1[pair], m->pair_geom2[pair]) == std::minmax(geom1, geom2))
      return pair;
  return -1;
}

double gap_of(const mjModel_* m, const mjContact_& contact, const GapArrays& gaps) {
  const int pair = defining_pair(m, contact.geom[0], contact.geom[1]);
  if (pair >= 0) return gaps.pair[pair];
  const auto of_side = [&](int side) {
    return contact.geom[side] < 0 ? gaps.flex[contact.flex[side]] : gaps.geom[contact.geom[side]];
  };
  return of_side(0) + of_side(1);
}

ContactParameters parameters_of_pair(const mjModel_* m, int pair) {
  return with_least_friction({m->pair_dim[pair], numbers<5>(m->pair_friction + 5 * pair),
                              numbers<2>(m->pair_solref + mjNREF * pair),
                              numbers<2>(m->pair_solreffriction + mjNREF * pair),
                              numbers<5>(m->pair_solimp + mjNIMP * pair)});
}

ContactParameters parameters_of_geoms(const mjModel_* m, int geom1, int geom2) {
  const int priority1 = m->geom_priority[geom1], priority2 = m->geom_priority[geom2];
  if (priority1 != priority2)
    return with_least_friction(of_geom(m, priority1 > priority2 ? geom1 : geom2));
  return with_least_friction(mixed(of_geom(m, geom1), of_geom(m, geom2),
                                   share_of_first(m->geom_solmix[geom1], m->geom_solmix[geom2])));
}

ContactInput contact_of_pair(const mjModel_* m, int geom1, int geom2) {
  const ContactParameters parameters = parameters_of(m, geom1, geom2);
  ContactInput input;
  input.geom = {geom1, geom2};
  input.dim = parameters.dim;
  input.friction = parameters.friction;
  input.solref = parameters.solref;
  input.solimp = parameters.solimp;
  input.has_solref = !is_default_impedance(input.solref.data(), input.solimp.data());
  return input;
}

}  // namespace dashpot::host
