#include "dashpot/detect/internal_edges.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>

#include "dashpot/model/properties.hpp"
#include "edge_passes.hpp"

namespace dashpot::host {

namespace {

using Eigen::Vector3d;

// Whether a body that moves has more than one geom, with those of what is welded to it.
bool has_more_geoms(const mjModel* m, int body) {
  int count = m->body_geomnum[body];
  for (int other = body + 1; other < m->nbody && m->body_parentid[other] >= body; ++other)
    if (m->body_weldid[other] == body) count += m->body_geomnum[other];
  return count > 1;
}

// Whether a contact is that of a round geom and a tile: of a geom without flat faces, and of one
// with some on a body that may have others beside it.
bool may_roll_over_internal_edge(const mjModel* m, const ContactInput& contact) {
  if (contact.is_of_flex() || !rolls_on(m, contact.geom[0], contact.geom[1])) return false;
  const int held_by = m->body_weldid[m->geom_bodyid[contact.geom[1]]];
  return held_by == 0 || has_more_geoms(m, held_by);
}

// Contacts of round geoms that roll over an internal edge: the tile ahead has one in the same
// place.
class GhostContacts {
 public:
  GhostContacts(const mjModel_* m, const mjData_* d, const Supports& supports, FaceBuffers& faces,
                std::vector<ContactInput>& contacts)
      : m_(m), d_(d), supports_(supports), faces_(faces), contacts_(contacts) {}

  // Where a round geom has left a tile over its edge, with all of its contacts from `first` to
  // `last` that touch, has others take them over and marks them (`at_internal_edge`). A line across
  // an internal edge stays on both sides. `successor`: a buffer.
  void replace(size_t first, size_t last, std::vector<int>& successor,
               std::vector<char>& at_internal_edge);

 private:
  int successor_of(size_t index);
  bool is_fixed_to(int geom, int other) const;
  bool is_before(size_t a, size_t b) const;
  bool are_in_one_place(const ContactInput& contact, const ContactInput& rest) const;
  bool is_beneath(const ContactInput& contact, const ContactInput& rest) const;
  bool is_flush(int geom, const ContactInput& rest);

  const mjModel_* m_;
  const mjData_* d_;
  const Supports& supports_;
  FaceBuffers& faces_;
  std::vector<ContactInput>& contacts_;
};

void GhostContacts::replace(size_t first, size_t last, std::vector<int>& successor,
                            std::vector<char>& at_internal_edge) {
  successor.clear();
  for (size_t i = first; i < last; ++i) {
    successor.push_back(successor_of(i));
    if (successor.back() < 0 && contacts_[i].gap < 0.0) return;
  }
  for (size_t i = first; i < last; ++i) {
    if (successor[i - first] < 0) continue;
    auto& others = contacts_[successor[i - first]].ghosts;
    const auto end = std::find(others.begin(), others.end(), -1);
    if (end != others.end() && std::find(others.begin(), end, contacts_[i].geom[1]) == end)
      *end = contacts_[i].geom[1];
    at_internal_edge[i] = 1;
  }
}

// The contact that a round geom has in the place of this one, but deeper, with another geom of the
// same body that is flush with the one here; -1 where there is none.
int GhostContacts::successor_of(size_t index) {
  const ContactInput& contact = contacts_[index];
  if (!may_roll_over_internal_edge(m_, contact)) return -1;
  const int geom = contact.geom[0], other = contact.geom[1];
  int deepest = -1;
  for (ContactSide at = supports_.first(supports_.body_of(contact, 0)); at.index >= 0;
       at = supports_.next(at)) {
    const ContactInput& rest = supports_.contact(at);
    const bool of_geom = at.side == 0 && rest.geom[0] == geom && rest.geom[1] != other;
    if (!of_geom || rest.gap >= 0.0 || !is_fixed_to(rest.geom[1], other)) continue;
    if (!is_before(at.index, deepest >= 0 ? deepest : index)) continue;
    if (is_beneath(contact, rest)) continue;
    if (are_in_one_place(contact, rest) && is_flush(other, rest)) deepest = at.index;
  }
  return deepest;
}

// With geoms of other bodies a contact at the internal edge is one that bears its part.
bool GhostContacts::is_fixed_to(int geom, int other) const {
  return m_->body_weldid[m_->geom_bodyid[geom]] == m_->body_weldid[m_->geom_bodyid[other]];
}

// Whether one of two contacts is deeper, or as deep and the first.
bool GhostContacts::is_before(size_t a, size_t b) const {
  return contacts_[a].gap != contacts_[b].gap ? contacts_[a].gap < contacts_[b].gap : a < b;
}

// A round geom of radius r that overlaps by s does so within sqrt(2 r s) of its lowest point; half
// as much again is for depths that differ (kDepths).
bool GhostContacts::are_in_one_place(const ContactInput& contact, const ContactInput& rest) const {
  const Eigen::Map<const Vector3d> a(contact.position.data()), b(rest.position.data());
  const double lens = std::sqrt(2.0 * m_->geom_rbound[rest.geom[0]] * -rest.gap);
  return (a - b).norm() <= kDepths * (lens + supports_.reach(rest));
}

// Whether a contact is with a face beneath the one of another contact: a layer of its own, which
// bears what is pressed through the one above. Over the edge of a tile a normal has turned before
// depths differ by as much.
bool GhostContacts::is_beneath(const ContactInput& contact, const ContactInput& rest) const {
  double cosine = 0.0;
  for (int i = 0; i < 3; ++i) cosine += contact.frame[i] * rest.frame[i];
  return cosine > kSameNormal && contact.gap - rest.gap > 2.0 * supports_.tolerance(rest);
}

// Whether the face of a geom along the normal of what geom 0 rests on is no higher than that.
bool GhostContacts::is_flush(int geom, const ContactInput& rest) {
  const Vector3d up = -Eigen::Map<const Vector3d>(rest.frame.data());
  if (!has_face_along(m_, d_, geom, up, kSameNormal, faces_)) return false;
  const double overlap =
      up.dot(supports_.support_point(geom, up) - supports_.support_point(rest.geom[0], -up));
  return overlap <= kDepths * -rest.gap + supports_.tolerance(rest);
}

// Notes on the contacts of a pair that its geom on `side` bears the other one up to an internal
// edge.
void mark_continued(size_t index, int side, std::vector<ContactInput>& contacts) {
  const std::array<int, 2> pair = contacts[index].geom;
  while (index > 0 && contacts[index - 1].is_of_pair(pair)) --index;
  for (; index < contacts.size() && contacts[index].is_of_pair(pair); ++index)
    contacts[index].continued = side;
}

}  // namespace

void drop_ghost_contacts(const mjModel_* m, const mjData_* d,
                         const std::vector<double>& start_reach, FaceBuffers& faces,
                         InternalEdgeBuffers& buffers, std::vector<ContactInput>& contacts) {
  const auto moves = [&](const ContactInput& c) {
    return !c.is_of_flex() && start_reach[c.geom[0]] + start_reach[c.geom[1]] >
                                  std::max(c.gap, kEdgeMotion * contact_radius(m, c));
  };
  const auto is_of_round_geom = [&](const ContactInput& c) {
    return may_roll_over_internal_edge(m, c);
  };
  if (std::none_of(contacts.begin(), contacts.end(), moves) &&
      std::none_of(contacts.begin(), contacts.end(), is_of_round_geom))
    return;
  const Supports supports(m, d, start_reach, buffers.supports, contacts);
  // Those to be dropped are found before any is: each may be what another body rests on.
  std::vector<char>& at_internal_edge = buffers.at_internal_edge;
  at_internal_edge.assign(contacts.size(), 0);
  EdgePasses passes(m, d, supports, faces);
  for (size_t i = 0; i < contacts.size(); ++i) {
    if (!moves(contacts[i])) continue;
    const ContactSide before = passes.before_edge(contacts[i]);
    if (before.index < 0) continue;
    at_internal_edge[i] = 1;
    mark_continued(before.index, 1 - before.side, contacts);
  }
  GhostContacts ghosts(m, d, supports, faces, contacts);
  // Contacts of a pair come one after the other.
  for (size_t first = 0, last; first < contacts.size(); first = last) {
    last = first + 1;
    while (last < contacts.size() && contacts[last].is_of_pair(contacts[first].geom)) ++last;
    ghosts.replace(first, last, buffers.successor, at_internal_edge);
  }
  size_t kept = 0;
  for (size_t i = 0; i < contacts.size(); ++i)
    if (!at_internal_edge[i]) {
      if (kept != i) contacts[kept] = contacts[i];
      ++kept;
    }
  contacts.resize(kept);
}

}  // namespace dashpot::host
