#include "dashpot/detection/seams.hpp"

#include <mujoco/mujoco.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>

#include "dashpot/detection/side_by_side.hpp"
#include "dashpot/mujoco/properties.hpp"
#include "dashpot/mujoco/velocities.hpp"

namespace dashpot::host {

namespace {

// Fractions of the smaller geom's radius: what tiles may differ by in height, and what counts as
// motion in a step.
constexpr double kTolerance = 1e-4;
constexpr double kMotion = 1e-5;
// Depths: those of one body under its load differ by less.
constexpr double kDepths = 1.5;
// Largest sag of what bears a geom, by the radius of the smaller geom: more is overlap that geoms
// were put in. And how many layers, one on another, are each looked at for being pressed into the
// next.
constexpr double kLargestSag = 0.05;
constexpr int kLayers = 4;
// Cosine between normals that are the same, and between those of tiles at whose edges round geoms
// pass, with the chord between these.
constexpr double kSameNormal = 0.9999;
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

// Whether a body that moves has more than one geom, with those of what is welded to it.
bool has_more_geoms(const mjModel* m, int body) {
  int count = m->body_geomnum[body];
  for (int other = body + 1; other < m->nbody && m->body_parentid[other] >= body; ++other)
    if (m->body_weldid[other] == body) count += m->body_geomnum[other];
  return count > 1;
}

// Whether a geom is round, and another one has flat faces.
bool rolls_on(const mjModel* m, int geom, int other) {
  switch (m->geom_type[geom]) {
    case mjGEOM_SPHERE:
    case mjGEOM_CAPSULE:
    case mjGEOM_ELLIPSOID:
    case mjGEOM_CYLINDER:
      return m->geom_type[other] == mjGEOM_BOX || m->geom_type[other] == mjGEOM_MESH;
    default:
      return false;
  }
}

// Whether a contact is that of a round geom and a tile: of a geom without flat faces, and of one
// with some on a body that may have others beside it.
bool may_roll_over_a_seam(const mjModel* m, const ContactInput& contact) {
  if (contact.is_of_flex() || !rolls_on(m, contact.geom[0], contact.geom[1])) return false;
  const int held_by = m->body_weldid[m->geom_bodyid[contact.geom[1]]];
  return held_by == 0 || has_more_geoms(m, held_by);
}

// A contact, and on which of its sides what is asked about is.
struct ContactSide {
  int index = -1, side = 0;
};

class Seams {
 public:
  Seams(const mjModel* m, const mjData* d, const std::vector<double>& start_reach,
        FaceBuffers& faces, SeamBuffers& buffers, const std::vector<ContactInput>& contacts)
      : m_(m),
        d_(d),
        start_reach_(start_reach),
        faces_(faces),
        buffers_(buffers),
        contacts_(contacts) {
    buffers.first.assign(m->nbody, -1);
    buffers.next.resize(2 * contacts.size());
    for (size_t i = 0; i < contacts.size(); ++i)
      for (int side = 0; side < 2; ++side)
        if (may_bear(contacts[i])) {
          int& first = buffers.first[body_of(contacts[i], side)];
          buffers.next[2 * i + side] = first;
          first = static_cast<int>(2 * i + side);
        }
  }

  double tolerance(const ContactInput& contact) const {
    const double radius = contact_radius(m_, contact);
    return std::isinf(radius) ? 0.0 : kTolerance * radius;
  }

  // Whether a body rests on something by a contact, or comes near it in the step.
  bool may_bear(const ContactInput& contact) const {
    return !contact.is_of_flex() &&
           contact.gap <= std::max(tolerance(contact),
                                   start_reach_[contact.geom[0]] + start_reach_[contact.geom[1]]);
  }

  // Speed (m/s) at which a gap closes, or an overlap grows.
  double closing(const ContactInput& contact) const {
    return std::max(0.0, -contact_velocity(m_, d_, contact)[0]);
  }

  // The contact that a round geom has in the place of this one, but deeper, with another geom of
  // the same body that is flush with the one here; -1 where there is none.
  int successor(size_t index) {
    const ContactInput& contact = contacts_[index];
    if (!may_roll_over_a_seam(m_, contact)) return -1;
    const int geom = contact.geom[0], other = contact.geom[1];
    int deepest = -1;
    for (int at = buffers_.first[body_of(contact, 0)]; at >= 0; at = buffers_.next[at]) {
      const ContactInput& rest = contacts_[at / 2];
      const bool of_geom = at % 2 == 0 && rest.geom[0] == geom && rest.geom[1] != other;
      if (!of_geom || rest.gap >= 0.0 || !is_fixed_to(rest.geom[1], other)) continue;
      if (!is_before(at / 2, deepest >= 0 ? deepest : index)) continue;
      if (is_beneath(contact, rest)) continue;
      if (are_in_one_place(contact, rest) && is_flush(other, rest)) deepest = at / 2;
    }
    return deepest;
  }

  // The contact with what bears a geom up to the seam that this one is at, and the side of that
  // geom; none where it is at none.
  ContactSide before_seam(const ContactInput& contact) {
    const bool may_pass[2] = {may_pass_over(contact, 0), may_pass_over(contact, 1)};
    if (!may_pass[0] && !may_pass[1]) return {};
    // What touches already does so at the rate of the start; what comes may be turned by others.
    if (contact.gap <= 0.0 &&
        m_->opt.timestep * closing(contact) <= kMotion * contact_radius(m_, contact))
      return {};
    for (int side = 0; side < 2; ++side) {
      if (!may_pass[side]) continue;
      const int body = body_of(contact, side), other = body_of(contact, 1 - side);
      // What all the world's contacts are with is not looked through for each of them: of what
      // rests on a static body, only the body of the other geom can be at a seam with itself.
      const bool is_static = m_->body_weldid[body] == 0;
      for (int at = buffers_.first[is_static ? other : body]; at >= 0; at = buffers_.next[at]) {
        const ContactInput& rest = contacts_[at / 2];
        const int rest_side = is_static ? 1 - at % 2 : at % 2;
        if (body_of(rest, rest_side) == body && passes(contact, side, rest, rest_side))
          return {at / 2, rest_side};
      }
    }
    return {};
  }

 private:
  // With geoms of other bodies a contact at the seam is one that bears its part.
  bool is_fixed_to(int geom, int other) const {
    return m_->body_weldid[m_->geom_bodyid[geom]] == m_->body_weldid[m_->geom_bodyid[other]];
  }

  // Whether one of two contacts is deeper, or as deep and the first.
  bool is_before(size_t a, size_t b) const {
    return contacts_[a].gap != contacts_[b].gap ? contacts_[a].gap < contacts_[b].gap : a < b;
  }

  // A round geom of radius r that overlaps by s does so within sqrt(2 r s) of its lowest point;
  // half as much again is for depths that differ, as above.
  bool are_in_one_place(const ContactInput& contact, const ContactInput& rest) const {
    const Eigen::Map<const Eigen::Vector3d> a(contact.position.data()), b(rest.position.data());
    const double lens = std::sqrt(2.0 * m_->geom_rbound[rest.geom[0]] * -rest.gap);
    const double way = start_reach_[rest.geom[0]] + start_reach_[rest.geom[1]];
    return (a - b).norm() <= kDepths * (lens + way);
  }

  // Whether a contact is with a face beneath the one of another contact: a layer of its own, which
  // bears what is pressed through the one above. Over the edge of a tile a normal has turned before
  // depths differ by as much.
  bool is_beneath(const ContactInput& contact, const ContactInput& rest) const {
    double cosine = 0.0;
    for (int i = 0; i < 3; ++i) cosine += contact.frame[i] * rest.frame[i];
    return cosine > kSameNormal && contact.gap - rest.gap > 2.0 * tolerance(rest);
  }

  // Whether the face of a geom along the normal of what geom 0 rests on is no higher than that.
  bool is_flush(int geom, const ContactInput& rest) {
    const Eigen::Vector3d up = -Eigen::Map<const Eigen::Vector3d>(rest.frame.data());
    if (!has_face_along(m_, d_, geom, up, kSameNormal, faces_)) return false;
    const double overlap = up.dot(support(geom, up) - support(rest.geom[0], -up));
    return overlap <= kDepths * -rest.gap + tolerance(rest);
  }

  // The body that moves a geom, or, of one that none does, its own.
  int body_of(const ContactInput& contact, int side) const {
    const int body = m_->geom_bodyid[contact.geom[side]], held_by = m_->body_weldid[body];
    return held_by != 0 ? held_by : body;
  }

  // Whether there may be a face or a straight side beneath the geom on `side`, which has an end.
  bool may_pass_over(const ContactInput& contact, int side) const {
    const int type = m_->geom_type[contact.geom[1 - side]];
    return (has_faces(type) || has_round_side(type)) && is_bounded(contact.geom[side]);
  }

  // Whether a geom whose highest point along `up` is given lies beneath the plane on which another
  // one rests by a contact of which that is the normal, as the next rail of a row of capsules.
  bool lies_beneath(const Eigen::Vector3d& highest, const Eigen::Vector3d& up,
                    const ContactInput& rest, double tolerance) const {
    const Eigen::Map<const Eigen::Vector3d> middle(rest.position.data());
    return up.dot(highest - middle) + 0.5 * (rest.gap + rest.margin) <= tolerance;
  }

  // Whether the geom has a bound in every direction.
  bool is_bounded(int geom) const {
    const int type = m_->geom_type[geom];
    return type != mjGEOM_PLANE && type != mjGEOM_HFIELD && has_shape(m_, geom);
  }

  // The point (world) of a geom that is farthest along a unit direction.
  Eigen::Vector3d support(int geom, const Eigen::Vector3d& direction) {
    const Shape& shape = buffers_.shapes.of(m_, geom);
    return core_support(shape, unchecked_geom_pose(d_, geom), direction) +
           sweep_radius(shape) * direction;
  }

  // Velocity (m/s) along a direction of a geom's body at a point.
  double rate_along(int geom, const Eigen::Vector3d& direction,
                    const Eigen::Vector3d& point) const {
    Eigen::Vector3d velocity;
    point_velocity(m_, d_, m_->geom_bodyid[geom], point.data(), velocity.data());
    return direction.dot(velocity);
  }

  // How far (m) geoms overlap, negative where they are apart, and how fast (m/s) that grows.
  struct Overlap {
    double now, rate;
  };

  // Along a direction, with a geom whose highest point along that is given; `at`: where they meet.
  Overlap overlap_along(int geom, int other, const Eigen::Vector3d& up,
                        const Eigen::Vector3d& highest, const Eigen::Vector3d& at) {
    const Eigen::Vector3d lowest = support(geom, -up);
    return {up.dot(highest - lowest), rate_along(other, up, at) - rate_along(geom, up, lowest)};
  }

  // With a face that is flush along `up`: where the geom comes to it, not at its far end, which may
  // be tilted up. What `rolls` is lifted as it goes along over that.
  Overlap overlap_with_flush(int geom, int other, const Eigen::Vector3d& face,
                             const Eigen::Vector3d& up, const Eigen::Vector3d& at, bool rolls) {
    const Eigen::Vector3d highest = support(other, up), lowest = support(geom, -up);
    Overlap overlap = overlap_along(geom, other, up, highest, highest);
    overlap.now = face.dot(support(other, face) - at) + up.dot(at - lowest);
    if (!rolls) return overlap;
    const Eigen::Map<const Eigen::Vector3d> centre(d_->geom_xpos + 3 * geom);
    const Eigen::Vector3d along = face - face.dot(up) * up;
    const double rise = rate_along(other, along, at) - rate_along(geom, along, centre);
    overlap.rate += std::max(0.0, rise) / face.dot(up);
    return overlap;
  }

  // How deep a body is pressed into what bears it along a direction, and that into the next, layer
  // by layer: its face lies so far beneath those beside it that bear nothing.
  double sag_along(int body, const Eigen::Vector3d& up, int layers) const {
    if (layers == 0 || m_->body_weldid[body] == 0) return 0.0;
    double sag = 0.0, beneath = 0.0;
    int last = -1;                           // contacts of a pair come one after the other
    const int root = m_->body_rootid[body];  // wheels and legs bear what they are jointed to
    for (int part = root; part < m_->nbody && m_->body_rootid[part] == root; ++part)
      for (int at = buffers_.first[part]; at >= 0; at = buffers_.next[at]) {
        const ContactInput& rest = contacts_[at / 2];
        const int bearer = body_of(rest, 1 - at % 2);
        if (rest.gap >= 0.0 || m_->body_rootid[bearer] == root) continue;
        const Eigen::Vector3d into =
            (at % 2 ? 1.0 : -1.0) * Eigen::Map<const Eigen::Vector3d>(rest.frame.data());
        if (into.dot(up) < kSameNormal) continue;
        if (bearer != last) beneath = sag_along(bearer, up, layers - 1);
        last = bearer;
        sag = std::max(sag, kDepths * -rest.gap + beneath);
      }
    return sag;
  }

  // Whether the geom on `side` passes over the other one, its body resting on what is across
  // `rest_side` of `rest`.
  bool passes(const ContactInput& contact, int side, const ContactInput& rest, int rest_side) {
    const int geom = contact.geom[side], other = contact.geom[1 - side];
    if (rest.geom[1 - rest_side] == other) return false;
    const Eigen::Vector3d up =  // m
        (rest_side ? 1.0 : -1.0) * Eigen::Map<const Eigen::Vector3d>(rest.frame.data());
    const Eigen::Map<const Eigen::Vector3d> normal(contact.frame.data());
    if ((side ? 1.0 : -1.0) * normal.dot(up) > kSameNormal) return false;
    const double depth =
        rest.gap > tolerance(rest) ? -rest.gap : kDepths * std::max(0.0, -rest.gap);
    const int tile = body_of(rest, 1 - rest_side);
    const double most_sag =
        m_->body_weldid[tile] == 0 ? 0.0 : kLargestSag * contact_radius(m_, contact);
    const double without_sag = depth + tolerance(contact), most = without_sag + most_sag;
    if (-contact.gap > most) return false;
    // Most pairs overlap by more, as their centres tell.
    const Eigen::Vector3d between = Eigen::Map<const Eigen::Vector3d>(d_->geom_xpos + 3 * other) -
                                    Eigen::Map<const Eigen::Vector3d>(d_->geom_xpos + 3 * geom);
    const bool rolls = rolls_on(m_, geom, other);
    const double reach = up.dot(between) + inner_radius(m_, other) + inner_radius(m_, geom) - most;
    if (reach > (rolls ? kTiltedChord * between.norm() : 0.0)) return false;
    // Up to which overlap at the end of the step the geom passes.
    const auto is_low = [&](const Overlap& overlap) {
      const double then =
          overlap.now + m_->opt.timestep * std::max(0.0, overlap.rate - closing(rest));
      if (std::max(then, -contact.gap) <= without_sag) return true;
      const double sag = most_sag > 0.0 ? std::min(most_sag, sag_along(tile, up, kLayers)) : 0.0;
      return std::max(then, -contact.gap) <= without_sag + sag;
    };
    const Eigen::Map<const Eigen::Vector3d> middle(contact.position.data());
    const Eigen::Vector3d at =  // on the other geom
        middle + (side ? -0.5 : 0.5) * (contact.gap + contact.margin) * normal;
    const Eigen::Vector3d highest = support(other, up);
    const std::optional<Eigen::Vector3d> face =
        face_normal_along(m_, d_, other, up, rolls ? kTilted : kSameNormal, faces_);
    if (face && face->dot(up) > kSameNormal)
      return reach <= 0.0 && is_low(overlap_with_flush(geom, other, *face, up, at, rolls));
    if (lies_beneath(highest, up, rest, tolerance(contact)))
      return reach <= 0.0 && is_low(overlap_along(geom, other, up, highest, highest));
    if (!face || (side ? 1.0 : -1.0) * normal.dot(*face) > kSameNormal) return false;
    if (depth > kLargestSag * contact_radius(m_, contact)) return false;
    // Of a face that is tilted farther, across its plane: along the normal of the one before what
    // rolls on both is higher beside its lowest point.
    return is_low(overlap_along(geom, other, *face, support(other, *face), at));
  }

  const mjModel* m_;
  const mjData* d_;
  const std::vector<double>& start_reach_;
  FaceBuffers& faces_;
  SeamBuffers& buffers_;
  const std::vector<ContactInput>& contacts_;
};

// Notes on the contacts of a pair that its geom on `side` bears the other one up to a seam.
void mark_continued(size_t index, int side, std::vector<ContactInput>& contacts) {
  const std::array<int, 2> pair = contacts[index].geom;
  while (index > 0 && contacts[index - 1].is_of_pair(pair)) --index;
  for (; index < contacts.size() && contacts[index].is_of_pair(pair); ++index)
    contacts[index].continued = side;
}

// Where a round geom has left a tile over its edge, with all of its contacts from `first` to `last`
// that touch, others take them over. A line across a seam stays on both sides.
void hand_over(Seams& seams, size_t first, size_t last, SeamBuffers& buffers,
               std::vector<ContactInput>& contacts) {
  std::vector<int>& successor = buffers.successor;
  successor.clear();
  for (size_t i = first; i < last; ++i) {
    successor.push_back(seams.successor(i));
    if (successor.back() < 0 && contacts[i].gap < 0.0) return;
  }
  for (size_t i = first; i < last; ++i) {
    if (successor[i - first] < 0) continue;
    auto& others = contacts[successor[i - first]].takes_over;
    const auto end = std::find(others.begin(), others.end(), -1);
    if (end != others.end() && std::find(others.begin(), end, contacts[i].geom[1]) == end)
      *end = contacts[i].geom[1];
    buffers.at_seam[i] = 1;
  }
}

}  // namespace

void drop_contacts_at_seams(const mjModel_* m, const mjData_* d,
                            const std::vector<double>& start_reach, FaceBuffers& faces,
                            SeamBuffers& buffers, std::vector<ContactInput>& contacts) {
  const auto moves = [&](const ContactInput& c) {
    return !c.is_of_flex() && start_reach[c.geom[0]] + start_reach[c.geom[1]] >
                                  std::max(c.gap, kMotion * contact_radius(m, c));
  };
  const auto is_of_round_geom = [&](const ContactInput& c) { return may_roll_over_a_seam(m, c); };
  if (std::none_of(contacts.begin(), contacts.end(), moves) &&
      std::none_of(contacts.begin(), contacts.end(), is_of_round_geom))
    return;
  Seams seams(m, d, start_reach, faces, buffers, contacts);
  // Those to be dropped are found before any is: each may be what another body rests on.
  size_t kept = 0;
  std::vector<char>& at_seam = buffers.at_seam;
  at_seam.assign(contacts.size(), 0);
  for (size_t i = 0; i < contacts.size(); ++i) {
    if (!moves(contacts[i])) continue;
    const ContactSide before = seams.before_seam(contacts[i]);
    if (before.index < 0) continue;
    at_seam[i] = 1;
    mark_continued(before.index, 1 - before.side, contacts);
  }
  // Contacts of a pair come one after the other.
  for (size_t first = 0, last; first < contacts.size(); first = last) {
    last = first + 1;
    while (last < contacts.size() && contacts[last].is_of_pair(contacts[first].geom)) ++last;
    hand_over(seams, first, last, buffers, contacts);
  }
  for (size_t i = 0; i < contacts.size(); ++i)
    if (!at_seam[i]) {
      if (kept != i) contacts[kept] = contacts[i];
      ++kept;
    }
  contacts.resize(kept);
}

}  // namespace dashpot::host
