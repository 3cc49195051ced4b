#include "dashpot/detect/internal_edges.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "dashpot/model/properties.hpp"
#include "face_contacts.hpp"

namespace dashpot::host {

namespace {

using Eigen::Vector3d;

// Largest sag of what bears a geom, by the radius of the smaller geom: more is overlap that geoms
// were put in. And how many layers are looked at for being pressed into the next.
constexpr double kLargestSag = 0.05;
constexpr int kLayers = 4;
// Cosine of the normals of tiles at whose edges round geoms pass, with the chord between these.
constexpr double kTilted = 0.985, kTiltedChord = 0.174;

// A radius about its centre that a geom contains; 0 where none is known.
double inner_radius(const mjModel* m, int geom) {
  const mjtNum* size = m->geom_size + 3 * geom;
  switch (m->geom_type[geom]) {
    case mjGEOM_SPHERE:
    case mjGEOM_CAPSULE:
      return size[0];
    case mjGEOM_CYLINDER:
      return std::min(size[0], size[1]);
    case mjGEOM_ELLIPSOID:
    case mjGEOM_BOX:
      return std::min({size[0], size[1], size[2]});
    default:
      return 0.0;
  }
}

// Whether a geom has a bound in every direction.
bool is_bounded(const mjModel* m, int geom) {
  const int type = m->geom_type[geom];
  return type != mjGEOM_PLANE && type != mjGEOM_HFIELD && has_shape(m, geom);
}

// The normal of a contact out of the geom on a side of it.
Vector3d normal_out_of(const ContactInput& contact, int side) {
  return (side ? -1.0 : 1.0) * Eigen::Map<const Vector3d>(contact.frame.data());
}

// The point of a contact on the surface of the geom on a side of it.
Vector3d point_on(const ContactInput& contact, int side) {
  const Eigen::Map<const Vector3d> middle(contact.position.data());
  return middle - 0.5 * (contact.gap + contact.margin) * normal_out_of(contact, side);
}

// Whether a geom whose highest point along `up` is given lies beneath the plane on which another
// one rests by a contact of which that is the normal, as the next rail of a row of capsules.
bool lies_beneath(const Vector3d& highest, const Vector3d& up, const ContactInput& rest,
                  double tolerance) {
  const Eigen::Map<const Vector3d> middle(rest.position.data());
  return up.dot(highest - middle) + 0.5 * (rest.gap + rest.margin) <= tolerance;
}

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

// Contacts of bodies that pass over the internal edge to the next tile, which are none; and those
// of round geoms that roll over one: the tile ahead has one in the same place.
class GhostContacts {
 public:
  GhostContacts(const mjModel_* m, const mjData_* d, const Supports& supports, FaceBuffers& faces,
                std::vector<ContactInput>& contacts)
      : m_(m), d_(d), supports_(supports), faces_(faces), contacts_(contacts) {}

  // The contact with what bears a geom up to the internal edge that a contact is at, and the side
  // of that geom; none where it is at none.
  ContactSide before_edge(const ContactInput& contact) {
    const bool may_pass[2] = {may_pass_over(contact, 0), may_pass_over(contact, 1)};
    if (!may_pass[0] && !may_pass[1]) return {};
    // What touches already does so at the rate of the start; what comes may be turned by others.
    if (contact.gap <= 0.0 &&
        m_->opt.timestep * supports_.closing(contact) <= kEdgeMotion * contact_radius(m_, contact))
      return {};
    for (int side = 0; side < 2; ++side) {
      if (!may_pass[side]) continue;
      const int body = supports_.body_of(contact, side),
                other = supports_.body_of(contact, 1 - side);
      // The world's contacts are not looked through for each of them: of what rests on a static
      // body, only the body of the other geom can be at an internal edge with itself.
      const bool is_static = m_->body_weldid[body] == 0;
      for (ContactSide at = supports_.first(is_static ? other : body); at.index >= 0;
           at = supports_.next(at)) {
        const ContactSide borne{at.index, is_static ? 1 - at.side : at.side};
        if (supports_.body_of(supports_.contact(borne), borne.side) == body &&
            passes(contact, side, borne))
          return borne;
      }
    }
    return {};
  }

  // Where a round geom has left a tile over its edge, with all of its contacts from `first` to
  // `last` that touch, has others take them over and marks them (`at_internal_edge`). A line across
  // an internal edge stays on both sides. `successor`: a buffer.
  void replace(size_t first, size_t last, std::vector<int>& successor,
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

 private:
  // How far (m) geoms overlap, negative where they are apart, and how fast (m/s) that grows.
  struct Overlap {
    double now, rate;
  };

  // Whether there may be a face or a straight side beneath the geom on `side`, which has an end.
  bool may_pass_over(const ContactInput& contact, int side) const {
    const int type = m_->geom_type[contact.geom[1 - side]];
    return (has_faces(type) || has_round_side(type)) && is_bounded(m_, contact.geom[side]);
  }

  // Whether the geom on `side` passes over the other one, its body resting on what is across `at`.
  bool passes(const ContactInput& contact, int side, ContactSide at) {
    const ContactInput& rest = supports_.contact(at);
    const int geom = contact.geom[side], other = contact.geom[1 - side];
    if (rest.geom[1 - at.side] == other) return false;
    const Vector3d up = -normal_out_of(rest, at.side);
    const Vector3d into = -normal_out_of(contact, side);
    if (into.dot(up) > kSameNormal) return false;
    const double tolerance = supports_.tolerance(contact);
    const double depth =
        rest.gap > supports_.tolerance(rest) ? -rest.gap : kDepths * std::max(0.0, -rest.gap);
    const int tile = supports_.body_of(rest, 1 - at.side);
    const double most_sag =
        m_->body_weldid[tile] == 0 ? 0.0 : kLargestSag * contact_radius(m_, contact);
    const double without_sag = depth + tolerance, most = without_sag + most_sag;
    if (-contact.gap > most) return false;
    // Most pairs overlap by more, as their centres tell.
    const Vector3d between = Eigen::Map<const Vector3d>(d_->geom_xpos + 3 * other) -
                             Eigen::Map<const Vector3d>(d_->geom_xpos + 3 * geom);
    const bool rolls = rolls_on(m_, geom, other);
    const double reach = up.dot(between) + inner_radius(m_, other) + inner_radius(m_, geom) - most;
    if (reach > (rolls ? kTiltedChord * between.norm() : 0.0)) return false;
    // Up to which overlap at the end of the step the geom passes.
    const auto is_low = [&](const Overlap& overlap) {
      const double growth = std::max(0.0, overlap.rate - supports_.closing(rest));
      const double then = std::max(overlap.now + m_->opt.timestep * growth, -contact.gap);
      if (then <= without_sag) return true;
      const double sag = most_sag > 0.0 ? std::min(most_sag, sag_along(tile, up, kLayers)) : 0.0;
      return then <= without_sag + sag;
    };
    const Vector3d met = point_on(contact, 1 - side), highest = supports_.support_point(other, up);
    const std::optional<Vector3d> face =
        face_normal_along(m_, d_, other, up, rolls ? kTilted : kSameNormal, faces_);
    if (face && face->dot(up) > kSameNormal)
      return reach <= 0.0 && is_low(overlap_with_flush(geom, other, *face, up, met, rolls));
    if (lies_beneath(highest, up, rest, tolerance))
      return reach <= 0.0 && is_low(overlap_along(geom, other, up, highest, highest));
    if (!face || into.dot(*face) > kSameNormal) return false;
    if (depth > kLargestSag * contact_radius(m_, contact)) return false;
    // Of a face that is tilted farther, across its plane: along the normal of the one before what
    // rolls on both is higher beside its lowest point.
    return is_low(overlap_along(geom, other, *face, supports_.support_point(other, *face), met));
  }

  // Along a direction, with a geom whose highest point along that is given; `at`: where they meet.
  Overlap overlap_along(int geom, int other, const Vector3d& up, const Vector3d& highest,
                        const Vector3d& at) const {
    const Vector3d lowest = supports_.support_point(geom, -up);
    return {up.dot(highest - lowest),
            supports_.rate_along(other, up, at) - supports_.rate_along(geom, up, lowest)};
  }

  // With a face that is flush along `up`: where the geom comes to it, not at its far end, which may
  // be tilted up. What `rolls` is lifted as it goes along over that.
  Overlap overlap_with_flush(int geom, int other, const Vector3d& face, const Vector3d& up,
                             const Vector3d& at, bool rolls) const {
    const Vector3d highest = supports_.support_point(other, up),
                   lowest = supports_.support_point(geom, -up);
    Overlap overlap = overlap_along(geom, other, up, highest, highest);
    overlap.now = face.dot(supports_.support_point(other, face) - at) + up.dot(at - lowest);
    if (!rolls) return overlap;
    const Eigen::Map<const Vector3d> centre(d_->geom_xpos + 3 * geom);
    const Vector3d along = face - face.dot(up) * up;
    const double rise =
        supports_.rate_along(other, along, at) - supports_.rate_along(geom, along, centre);
    overlap.rate += std::max(0.0, rise) / face.dot(up);
    return overlap;
  }

  // How deep a body is pressed into what bears it along a direction, and that into the next, layer
  // by layer: its face lies so far beneath those beside it that bear nothing.
  double sag_along(int body, const Vector3d& up, int layers) const {
    if (layers == 0 || m_->body_weldid[body] == 0) return 0.0;
    double sag = 0.0, beneath = 0.0;
    int last = -1;                           // contacts of a pair come one after the other
    const int root = m_->body_rootid[body];  // wheels and legs bear what they are jointed to
    for (int part = root; part < m_->nbody && m_->body_rootid[part] == root; ++part)
      for (ContactSide at = supports_.first(part); at.index >= 0; at = supports_.next(at)) {
        const ContactInput& rest = supports_.contact(at);
        const int support = supports_.body_of(rest, 1 - at.side);
        if (rest.gap >= 0.0 || m_->body_rootid[support] == root) continue;
        if (-normal_out_of(rest, at.side).dot(up) < kSameNormal) continue;
        if (support != last) beneath = sag_along(support, up, layers - 1);
        last = support;
        sag = std::max(sag, kDepths * -rest.gap + beneath);
      }
    return sag;
  }

  // The contact that a round geom has in the place of this one, but deeper, with another geom of
  // the same body that is flush with the one here; -1 where there is none.
  int successor_of(size_t index) {
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
  bool is_fixed_to(int geom, int other) const {
    return m_->body_weldid[m_->geom_bodyid[geom]] == m_->body_weldid[m_->geom_bodyid[other]];
  }

  // Whether one of two contacts is deeper, or as deep and the first.
  bool is_before(size_t a, size_t b) const {
    return contacts_[a].gap != contacts_[b].gap ? contacts_[a].gap < contacts_[b].gap : a < b;
  }

  // A round geom of radius r that overlaps by s does so within sqrt(2 r s) of its lowest point;
  // half as much again is for depths that differ (kDepths).
  bool are_in_one_place(const ContactInput& contact, const ContactInput& rest) const {
    const Eigen::Map<const Vector3d> a(contact.position.data()), b(rest.position.data());
    const double lens = std::sqrt(2.0 * m_->geom_rbound[rest.geom[0]] * -rest.gap);
    return (a - b).norm() <= kDepths * (lens + supports_.reach(rest));
  }

  // Whether a contact is with a face beneath the one of another contact: a layer of its own, which
  // bears what is pressed through the one above. Over the edge of a tile a normal has turned before
  // depths differ by as much.
  bool is_beneath(const ContactInput& contact, const ContactInput& rest) const {
    double cosine = 0.0;
    for (int i = 0; i < 3; ++i) cosine += contact.frame[i] * rest.frame[i];
    return cosine > kSameNormal && contact.gap - rest.gap > 2.0 * supports_.tolerance(rest);
  }

  // Whether the face of a geom along the normal of what geom 0 rests on is no higher than that.
  bool is_flush(int geom, const ContactInput& rest) {
    const Vector3d up = -Eigen::Map<const Vector3d>(rest.frame.data());
    if (!face_normal_along(m_, d_, geom, up, kSameNormal, faces_)) return false;
    const double overlap =
        up.dot(supports_.support_point(geom, up) - supports_.support_point(rest.geom[0], -up));
    return overlap <= kDepths * -rest.gap + supports_.tolerance(rest);
  }

  const mjModel_* m_;
  const mjData_* d_;
  const Supports& supports_;
  FaceBuffers& faces_;
  std::vector<ContactInput>& contacts_;
};

// Notes on contacts of a pair that its geom on `side` bears the other one up to an internal edge.
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
  GhostContacts ghosts(m, d, supports, faces, contacts);
  for (size_t i = 0; i < contacts.size(); ++i) {
    if (!moves(contacts[i])) continue;
    const ContactSide before = ghosts.before_edge(contacts[i]);
    if (before.index < 0) continue;
    at_internal_edge[i] = 1;
    mark_continued(before.index, 1 - before.side, contacts);
  }
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
