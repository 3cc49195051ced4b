#include "edge_passes.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <optional>

#include "dashpot/model/properties.hpp"
#include "side_by_side.hpp"

namespace dashpot::host {

namespace {

using Eigen::Vector3d;

// Largest sag of what bears a geom, by the radius of the smaller geom: more is overlap that geoms
// were put in. And how many layers, one on another, are each looked at for being pressed into the
// next.
constexpr double kLargestSag = 0.05;
constexpr int kLayers = 4;
// Cosine between the normals of tiles at whose edges round geoms pass, with the chord between
// these.
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

}  // namespace

ContactSide EdgePasses::before_edge(const ContactInput& contact) {
  const bool may_pass[2] = {may_pass_over(contact, 0), may_pass_over(contact, 1)};
  if (!may_pass[0] && !may_pass[1]) return {};
  // What touches already does so at the rate of the start; what comes may be turned by others.
  if (contact.gap <= 0.0 &&
      m_->opt.timestep * supports_.closing(contact) <= kEdgeMotion * contact_radius(m_, contact))
    return {};
  for (int side = 0; side < 2; ++side) {
    if (!may_pass[side]) continue;
    const int body = supports_.body_of(contact, side), other = supports_.body_of(contact, 1 - side);
    // What all the world's contacts are with is not looked through for each of them: of what
    // rests on a static body, only the body of the other geom can be at an internal edge with
    // itself.
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

// Whether there may be a face or a straight side beneath the geom on `side`, which has an end.
bool EdgePasses::may_pass_over(const ContactInput& contact, int side) const {
  const int type = m_->geom_type[contact.geom[1 - side]];
  return (has_faces(type) || has_round_side(type)) && is_bounded(m_, contact.geom[side]);
}

// Whether the geom on `side` passes over the other one, its body resting on what is across `at`.
bool EdgePasses::passes(const ContactInput& contact, int side, ContactSide at) {
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
EdgePasses::Overlap EdgePasses::overlap_along(int geom, int other, const Vector3d& up,
                                              const Vector3d& highest, const Vector3d& at) const {
  const Vector3d lowest = supports_.support_point(geom, -up);
  return {up.dot(highest - lowest),
          supports_.rate_along(other, up, at) - supports_.rate_along(geom, up, lowest)};
}

// With a face that is flush along `up`: where the geom comes to it, not at its far end, which may
// be tilted up. What `rolls` is lifted as it goes along over that.
EdgePasses::Overlap EdgePasses::overlap_with_flush(int geom, int other, const Vector3d& face,
                                                   const Vector3d& up, const Vector3d& at,
                                                   bool rolls) const {
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
double EdgePasses::sag_along(int body, const Vector3d& up, int layers) const {
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

}  // namespace dashpot::host
