#include "dashpot/mujoco_turning.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "dashpot/mujoco_collisions.hpp"
#include "dashpot/mujoco_faces.hpp"
#include "dashpot/mujoco_moved_axes.hpp"
#include "dashpot/mujoco_moved_geom.hpp"
#include "dashpot/mujoco_properties.hpp"
#include "dashpot/mujoco_side_by_side.hpp"
#include "dashpot/mujoco_workplaces.hpp"
#include "dashpot/terrain_contacts.hpp"

namespace dashpot::host {

namespace {

// Turn in a step (rad), and way relative to the size of the smaller geom, up to which a pair is at
// rest: what curves there is a height of 1e-10 of that size.
constexpr double kStill = 1e-5;
// The same way up to which a pair meets where it did: a ball that slides off a tile meets its edge
// in the middle, though it is on the next tile by then. Planes have no edges; beyond, what is round
// is still on a face whose normal it meets, but for blows, which are over or to come by then.
constexpr double kFarWay = 0.1;
// Cosine between the normals, in the frame of a geom, of contacts on one of its faces.
constexpr double kOfFace = 0.999999;
// How far, relative to the same, a contact point moves on along a rim or a surface up to the
// middle: that of a disc that has almost come to rest runs around it faster than steps can follow.
constexpr double kFarPoint = 0.5;
// Part of the step within which a gap or an overlap that closes at its present rate is gone early.
constexpr double kEarly = 0.25;
// Cosine between the normals of one contact at the start and in the middle.
constexpr double kSame = 0.85;
constexpr int kContactsAtOnce = 16;  // by a thread

// A contact that the collision of a pair finds in the middle, and its place on the two geoms.
struct MiddleContact {
  mjtNum distance, position[3], normal[3];
  mjtNum local_normal[2][3];  // in the frames of the geoms
  std::array<double, 3> local[2];
  std::array<double, 3> on_shape[2];  // the same on what does not turn about its own axis
};

// One of the two geoms of a pair.
struct Side {
  int geom = -1, body = -1;
  bool is_free = false;              // belongs to a free body
  mjtNum angular[3]{}, linear[3]{};  // of its body's centre of mass, world
  // Of all but free bodies, about the centre of mass of the tree: at the start and in the middle.
  mjtNum twist[2][6]{};
};

double squared_distance(const std::array<double, 3>& a, const std::array<double, 3>& b) {
  double sum = 0.0;
  for (int i = 0; i < 3; ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return sum;
}

// On the geom on which the two are nearer: on a wheel, the place as it turns with it, or stays.
double squared_distance(const ContactInput& start, const MiddleContact& middle) {
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 2; ++i)
    least = std::min({least, squared_distance(start.local_position[i], middle.local[i]),
                      squared_distance(start.local_position[i], middle.on_shape[i])});
  return least;
}

// A ball that turns about its middle looks the same.
bool is_ball(const mjModel* m, int geom) {
  return m->geom_type[geom] == mjGEOM_SPHERE &&
         mju_dist3(m->geom_pos + 3 * geom, m->body_ipos + 3 * m->geom_bodyid[geom]) == 0.0;
}

// Contacts of a signed distance field are points of a search, which do not follow the pose.
bool is_distance_field(const mjModel* m, int geom) { return m->geom_type[geom] == mjGEOM_SDF; }

// Whether the points in which a geom touches are fixed to it: corners, not places on a rim.
bool has_corners(const mjModel* m, int geom) {
  const int type = m->geom_type[geom];
  return type == mjGEOM_PLANE || type == mjGEOM_BOX || type == mjGEOM_MESH;
}

class TurningPair {
 public:
  // Of the contacts from `first` to `last`; `time` (s) leads to the middle.
  TurningPair(mjModel* m, mjData* d, double time, FaceBuffers& faces, ContactInput* first,
              ContactInput* last)
      : model_(m), data_(d), time_(time), faces_(faces), first_(first), last_(last) {}

  // Finds how the pair moves; whether it does, and may touch up to the middle.
  bool moves(const Trees& trees, const double* motion) {
    if (first_->is_at_impact) return false;
    for (int i = 0; i < 2; ++i) {
      Side& side = side_[i];
      side.geom = first_->geom[i];
      if (side.geom < 0 || is_distance_field(model_, side.geom)) return false;
      side.body = model_->geom_bodyid[side.geom];
    }
    const bool on_plane = model_->geom_type[side_[0].geom] == mjGEOM_PLANE;
    for (int i = 0; i < 2; ++i) find_motion(first_->tree[i], trees, motion, side_[i]);
    if (on_plane && side_[1].is_free && is_ball(model_, side_[1].geom)) return false;
    mju_sub3(relative_, side_[1].linear, side_[0].linear);
    const double way = 2.0 * time_ * speed_along();
    const double turn =
        2.0 * time_ * std::max(mju_norm3(side_[0].angular), mju_norm3(side_[1].angular));
    at_rest_ = is_still(turn, way);
    if (at_rest_) return false;
    is_far_ = way > kFarWay * size() && !on_plane;
    if (is_far_ && side_with_faces() < 0) return false;
    if (are_round() && parts_early()) return false;
    way_ = way_to_middle();
    return std::any_of(first_, last_, [&](const ContactInput& c) { return c.gap <= way_; });
  }

  // Of a pair whose contacts stay where they are, takes to the middle the axes of the joints that
  // hold it there: those of a leg turn though its foot stands.
  void turn_axes() {
    if (!at_rest_ || !(joints_move(side_[0]) || joints_move(side_[1]))) return;
    find_twists();
    for (ContactInput* contact = first_; contact != last_; ++contact) {
      if (contact->gap > 0.0) continue;
      const std::array<double, 3> start = point_rate(*contact, 0), middle = point_rate(*contact, 1);
      mjtNum change[3];
      mju_sub3(change, middle.data(), start.data());
      if (2.0 * time_ * mju_norm3(change) <= kStill * kStill * size()) continue;
      contact->ahead = time_;
      for (int i = 0; i < 3; ++i) contact->turning[i] = change[i] / time_;
    }
  }

  // Takes the contacts that are found there to the middle.
  void take() {
    find_contacts();
    find_twists();
    const bool corners = has_corners(model_, side_[0].geom) && has_corners(model_, side_[1].geom);
    for (ContactInput* contact = first_; contact != last_; ++contact) {
      // At a seam the middle may be beyond the edge, where the other geom's face goes on.
      if (contact->is_at_seam()) continue;
      const MiddleContact* const same = nearest(*contact);
      if (!same || nearest(*same) != contact) continue;
      const double far = corners ? 2.0 * way_ : kFarPoint * size();
      if (squared_distance(*contact, *same) > far * far) continue;
      if (mju_dot3(same->normal, contact->frame.data()) < kSame) continue;
      if (is_far_ && !stays_on_face(*contact, *same)) continue;
      take(*same, *contact);
    }
  }

 private:
  // `turn` (rad) and `way` (m) in a step.
  bool is_still(double turn, double way) const { return turn <= kStill && way <= kStill * size(); }

  // Which of the two has faces, -1 where both or neither have.
  int side_with_faces() const {
    const bool faces[2] = {has_corners(model_, side_[0].geom), has_corners(model_, side_[1].geom)};
    return faces[0] == faces[1] ? -1 : (faces[0] ? 0 : 1);
  }

  bool stays_on_face(const ContactInput& contact, const MiddleContact& middle) const {
    if (std::abs(middle.distance - contact.margin - contact.gap) > 0.5 * kFarWay * size())
      return false;
    const int side = side_with_faces();
    mjtNum normal[3];
    mju_mulMatTVec3(normal, data_->geom_xmat + 9 * side_[side].geom, contact.frame.data());
    return mju_dot3(normal, middle.local_normal[side]) > kOfFace;
  }

  // Free bodies have theirs in the coordinates of their tree.
  void find_motion(int tree, const Trees& trees, const double* motion, Side& side) const {
    side.is_free = tree >= 0 && trees.tree[tree].free_body;
    if (side.is_free) {
      mju_copy3(side.linear, motion + trees.tree[tree].begin);
      mju_copy3(side.angular, motion + trees.tree[tree].begin + 4);
      return;
    }
    velocity_at(model_, data_, side.body, data_->xipos + 3 * side.body, side.angular, side.linear);
  }

  // Whether the normal turns wherever the two touch.
  bool are_round() const {
    return std::all_of(side_.begin(), side_.end(), [&](const Side& side) {
      const int type = model_->geom_type[side.geom];
      return type == mjGEOM_SPHERE || type == mjGEOM_CAPSULE || type == mjGEOM_ELLIPSOID;
    });
  }

  // Whether a blow begins or ends early in the step, by how fast the gap changes: forces that act
  // before the middle alone do work on what the turn of the normal adds to the rate.
  bool parts_early() const {
    mjtNum velocity[2][3];
    for (int i = 0; i < 2; ++i) {
      mjtNum arm[3];
      mju_sub3(arm, first_->position.data(), data_->xipos + 3 * side_[i].body);
      mju_cross(velocity[i], side_[i].angular, arm);
      mju_addTo3(velocity[i], side_[i].linear);
    }
    mju_subFrom3(velocity[1], velocity[0]);
    const double rate = std::abs(mju_dot3(first_->frame.data(), velocity[1]));
    return std::abs(first_->gap) < kEarly * 2.0 * time_ * rate;
  }

  // Radius about the smaller geom; planes have none.
  double size() const {
    double least = std::numeric_limits<double>::infinity();
    for (const Side& side : side_)
      if (model_->geom_rbound[side.geom] > 0.0)
        least = std::min<double>(least, model_->geom_rbound[side.geom]);
    return least;
  }

  // How fast (m/s) the centre of the smaller geom moves on the body of the other: not at all where
  // both turn as one, however far from each other the centres of mass of the bodies are.
  double speed_along() const {
    const double radius[2] = {model_->geom_rbound[side_[0].geom],
                              model_->geom_rbound[side_[1].geom]};
    const int smaller = radius[1] == 0.0 || (radius[0] > 0.0 && radius[0] < radius[1]) ? 0 : 1;
    const mjtNum* centre = data_->geom_xpos + 3 * side_[smaller].geom;
    mjtNum velocity[2][3];
    for (int i = 0; i < 2; ++i) {
      mjtNum arm[3];
      mju_sub3(arm, centre, data_->xipos + 3 * side_[i].body);
      mju_cross(velocity[i], side_[i].angular, arm);
      mju_addTo3(velocity[i], side_[i].linear);
    }
    return mju_dist3(velocity[0], velocity[1]);
  }

  // The farthest that any two points of the geoms move along each other.
  double way_to_middle() const {
    double speed = mju_norm3(relative_);
    for (const Side& side : side_)
      speed += mju_norm3(side.angular) *
               (model_->geom_rbound[side.geom] +
                mju_dist3(data_->geom_xpos + 3 * side.geom, data_->xipos + 3 * side.body));
    return time_ * speed;
  }

  // Whether any joint does that a link hangs on.
  bool joints_move(const Side& side) const {
    if (side.is_free) return false;
    for (int dof = last_dof(model_, side.body); dof >= 0; dof = model_->dof_parentid[dof])
      if (2.0 * time_ * std::abs(data_->qvel[dof]) > kStill) return true;
    return false;
  }

  void find_twists() {
    for (Side& side : side_) {
      if (side.is_free) continue;
      twist_ahead(model_, data_, side.body, 0.0, side.twist[0]);
      twist_ahead(model_, data_, side.body, time_, side.twist[1]);
    }
  }

  void find_contacts() {
    const int geom1 = side_[0].geom, geom2 = side_[1].geom;
    const MovedGeom moved1(model_, data_, geom1, time_), moved2(model_, data_, geom2, time_);
    const ReplacedCollisions replaced(model_, &faces_, nullptr);
    mjPreContact found[mjMAXCONPAIR];
    count_ = collide_all(model_, data_, geom1, geom2, first_->margin + way_, found);
    for (int i = 0; i < count_; ++i) {
      MiddleContact& middle = middle_[i];
      middle.distance = found[i].dist;
      mju_copy3(middle.position, found[i].pos);
      mju_copy3(middle.normal, found[i].normal);
      for (int side = 0; side < 2; ++side) {
        const int geom = side_[side].geom;
        mjtNum arm[3];
        mju_sub3(arm, found[i].pos, data_->geom_xpos + 3 * geom);
        mju_mulMatTVec3(middle.local[side].data(), data_->geom_xmat + 9 * geom, arm);
        mju_mulMatTVec3(middle.local_normal[side], data_->geom_xmat + 9 * geom, found[i].normal);
        middle.on_shape[side] = before_spin(side_[side], middle.local[side]);
      }
    }
    mju_copy(rotation_, data_->geom_xmat + 9 * geom1, 9);
  }

  // A place in the frame of a geom, turned on by what the geom has spun about its own axis.
  std::array<double, 3> before_spin(const Side& side, const std::array<double, 3>& local) const {
    if (!has_round_side(model_->geom_type[side.geom])) return local;
    const mjtNum* rotation = data_->geom_xmat + 9 * side.geom;
    const mjtNum axis[3] = {rotation[2], rotation[5], rotation[8]};
    const double angle = time_ * mju_dot3(side.angular, axis);
    const double cosine = std::cos(angle), sine = std::sin(angle);
    return {cosine * local[0] - sine * local[1], sine * local[0] + cosine * local[1], local[2]};
  }

  const MiddleContact* nearest(const ContactInput& contact) const {
    const MiddleContact* const end = middle_.data() + count_;
    const MiddleContact* const least =
        std::min_element(middle_.data(), end, [&](const MiddleContact& a, const MiddleContact& b) {
          return distance_of(contact, a) < distance_of(contact, b);
        });
    return least == end || std::isinf(distance_of(contact, *least)) ? nullptr : least;
  }

  const ContactInput* nearest(const MiddleContact& middle) const {
    return std::min_element(first_, last_, [&](const ContactInput& a, const ContactInput& b) {
      return distance_of(a, middle) < distance_of(b, middle);
    });
  }

  // Squared, infinite where the one is no continuation of the other.
  double distance_of(const ContactInput& contact, const MiddleContact& middle) const {
    return is_across_groove(contact, middle) ? std::numeric_limits<double>::infinity()
                                             : squared_distance(contact, middle);
  }

  // Whether the two are on sides of a height field that rise from each other. What rolls from the
  // one to the other hits that, but for what is soft enough to touch both in one place; where the
  // surface stands out the normal turns on. A contact apart is with the plane of its side, wherever
  // that side begins.
  bool is_across_groove(const ContactInput& contact, const MiddleContact& middle) const {
    if (model_->geom_type[side_[0].geom] != mjGEOM_HFIELD) return false;
    mjtNum start[3], turn[3], way[3], relative[3];
    mju_mulMatTVec3(start, contact.rotation.data(), contact.frame.data());
    mju_mulMatTVec3(turn, rotation_, middle.normal);
    mju_subFrom3(turn, start);
    const double angle = mju_norm3(turn), small = kStill * size();
    if (angle <= kFlatBend) return false;
    mju_mulMatTVec3(relative, contact.rotation.data(), relative_);
    const double approach = 2.0 * time_ * mju_dot3(turn, relative);
    if (are_in_one_place(contact.gap, angle * size(), angle, approach)) return false;
    mju_sub3(way, middle.local[0].data(), contact.local_position[0].data());
    return contact.gap > small || mju_dot3(turn, way) < -small * angle;
  }

  // From where its centre of mass is at the start each free body sees the point as in the middle;
  // axes of joints and twists go there themselves.
  void take(const MiddleContact& middle, ContactInput& contact) const {
    const std::array<double, 3> start_rate = point_rate(contact, 0);
    const double apart = std::max(0.0, middle.distance - contact.margin);
    mjtNum point[2][3];
    for (int i = 0; i < 2; ++i) {
      mju_addScl3(point[i], middle.position, middle.normal, (i == 0 ? -0.5 : 0.5) * apart);
      if (side_[i].is_free) mju_addToScl3(point[i], side_[i].linear, -time_);
    }
    for (int i = 0; i < 3; ++i) {
      contact.position[i] = 0.5 * (point[0][i] + point[1][i]);
      contact.apart[i] = point[1][i] - point[0][i];
    }
    mjtNum* const frame = contact.frame.data();
    mju_copy3(frame, middle.normal);
    mju_addToScl3(frame + 3, frame, -mju_dot3(frame, frame + 3));
    mju_normalize3(frame + 3);
    mju_cross(frame + 6, frame, frame + 3);
    const std::array<double, 3> rate = point_rate(contact, 1);
    contact.is_in_middle = true;
    contact.ahead = time_;
    for (int i = 0; i < 3; ++i) contact.turning[i] = (rate[i] - start_rate[i]) / time_;
    mju_copy(data_->contact[contact.source].frame, frame, 9);
    std::copy_n(rotation_, 9, contact.rotation.begin());
  }

  // Velocity of the point on the second geom to that on the first, in the contact's frame; `when`:
  // 0 at the start, 1 in the middle.
  std::array<double, 3> point_rate(const ContactInput& contact, int when) const {
    mjtNum relative[3] = {0, 0, 0};
    for (int i = 0; i < 2; ++i) {
      const Side& side = side_[i];
      const mjtNum sign = i == 0 ? -1.0 : 1.0;
      const mjtNum* centre = side.is_free ? data_->xipos + 3 * side.body
                                          : data_->subtree_com + 3 * model_->body_rootid[side.body];
      mjtNum arm[3], velocity[3];
      for (int k = 0; k < 3; ++k)
        arm[k] = contact.position[k] + 0.5 * sign * contact.apart[k] - centre[k];
      mju_cross(velocity, side.is_free ? side.angular : side.twist[when], arm);
      mju_addTo3(velocity, side.is_free ? side.linear : side.twist[when] + 3);
      mju_addToScl3(relative, velocity, sign);
    }
    std::array<double, 3> rate;
    mju_mulMatVec3(rate.data(), contact.frame.data(), relative);
    return rate;
  }

  mjModel* model_;
  mjData* data_;
  double time_;
  FaceBuffers& faces_;
  ContactInput *first_, *last_;
  std::array<Side, 2> side_;
  bool at_rest_ = false;  // its geoms, on each other
  bool is_far_ = false;   // they may come to another face up to the middle
  mjtNum relative_[3]{};  // velocity of side 1 to side 0
  double way_ = 0.0;      // m, to the middle
  std::array<MiddleContact, mjMAXCONPAIR> middle_;
  int count_ = 0;
  mjtNum rotation_[9]{};  // of the first geom in the middle
};

}  // namespace

void take_to_middle(mjModel_* m, mjData_* d, double length, const Trees& trees,
                    const double* motion, FaceBuffers& faces, Workplaces& workplaces,
                    std::vector<ContactInput>& contacts, std::vector<char>& taken, Team& team) {
  const int count = static_cast<int>(contacts.size());
  const auto begins_pair = [&](int i) {
    return i == 0 || i == count || !contacts[i].is_of_pair(contacts[i - 1].geom);
  };
  workplaces.open(m, d, &faces, count > kContactsAtOnce ? team.active() : 1);
  team.share(count, kContactsAtOnce, [&](int worker, int begin, int end) {
    const Workplace at(workplaces, worker);
    // Pairs that begin in the range.
    while (begin < end && !begins_pair(begin)) ++begin;
    for (int first = begin, last; first < end; first = last) {
      last = first + 1;
      while (!begins_pair(last)) ++last;
      TurningPair pair(at.model(), at.data(), 0.5 * length, *at.faces(), contacts.data() + first,
                       contacts.data() + last);
      if (pair.moves(trees, motion))
        pair.take();
      else
        pair.turn_axes();
    }
  });
  workplaces.close();
  for (const ContactInput& contact : contacts)
    if (contact.is_in_middle)
      for (int tree : contact.tree)
        if (tree >= 0) taken[tree] = 1;
}

}  // namespace dashpot::host
