#include "contact_motion.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dashpot/model/body_inertia.hpp"
#include "dashpot/model/mocap_bodies.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/model/velocities.hpp"

namespace dashpot::host {

namespace {

// Cosine of the angle of a normal to a cylinder's axis up to which it is one of its side.
constexpr double kOnSide = 1e-6;
// Of the radius of a ball, by which rounding may take its centre from the centre of mass.
constexpr double kRounding = 1e-9;

bool is_round_all_over(int type) {
  return type == mjGEOM_SPHERE || type == mjGEOM_CAPSULE || type == mjGEOM_ELLIPSOID;
}

// Whether the points in which a geom touches are fixed to it: corners, not places on a rim.
bool has_corners(const mjModel* m, int geom) {
  const int type = m->geom_type[geom];
  return type == mjGEOM_PLANE || type == mjGEOM_BOX || type == mjGEOM_MESH;
}

}  // namespace

bool ContactMotion::find(const ContactInput& contact, const TurningStep& step) {
  for (int i = 0; i < 2; ++i) {
    Side& side = side_[i];
    side.geom = contact.geom[i];
    if (side.geom < 0 || model_->geom_type[side.geom] == mjGEOM_SDF) return false;
    side.body = model_->geom_bodyid[side.geom];
    side.centre = centre_of_motion(model_, data_, side.body);
  }
  for (int i = 0; i < 2; ++i) find_velocity(contact.tree[i], step, side_[i]);
  mju_sub3(relative_, side_[1].linear, side_[0].linear);
  return true;
}

// Free bodies have theirs in the coordinates of their tree.
void ContactMotion::find_velocity(int tree, const TurningStep& step, Side& side) const {
  side.is_free = tree >= 0 && step.trees.tree[tree].free_body;
  if (side.is_free) {
    const double* velocity = step.motion + step.trees.tree[tree].begin;
    mju_copy3(side.linear, velocity);
    mju_copy3(side.angular, velocity + 4);
    return;
  }
  velocity_at(model_, data_, side.body, side.centre, side.angular, side.linear);
}

void ContactMotion::velocity_of(const Side& side, const mjtNum* point, mjtNum* velocity) const {
  mjtNum arm[3];
  mju_sub3(arm, point, side.centre);
  mju_cross(velocity, side.angular, arm);
  mju_addTo3(velocity, side.linear);
}

double ContactMotion::gravity() const { return usual_gravity(model_); }

bool ContactMotion::is_ball(int side) const { return geom_type(side) == mjGEOM_SPHERE; }

bool ContactMotion::is_free_ball(int side) const {
  const int geom = side_[side].geom;
  if (!is_free(side) || !is_ball(side)) return false;
  if (has_welded_parts(model_, model_->body_treeid[side_[side].body]))
    return mju_dist3(data_->geom_xpos + 3 * geom, side_[side].centre) <=
           kRounding * model_->geom_rbound[geom];
  return mju_dist3(model_->geom_pos + 3 * geom, model_->body_ipos + 3 * side_[side].body) == 0.0;
}

bool ContactMotion::are_round() const {
  return is_round_all_over(geom_type(0)) && is_round_all_over(geom_type(1));
}

bool ContactMotion::have_corners() const {
  return has_corners(model_, side_[0].geom) && has_corners(model_, side_[1].geom);
}

bool ContactMotion::is_round_along(int side, const mjtNum* local) const {
  const int type = geom_type(side);
  return is_round_all_over(type) || (type == mjGEOM_CYLINDER && std::abs(local[2]) < kOnSide);
}

double ContactMotion::size() const {
  double least = std::numeric_limits<double>::infinity();
  for (const Side& side : side_)
    if (model_->geom_rbound[side.geom] > 0.0)
      least = std::min<double>(least, model_->geom_rbound[side.geom]);
  return least;
}

double ContactMotion::thickness() const {
  double least = std::numeric_limits<double>::infinity();
  for (const Side& side : side_) {
    const mjtNum* half = model_->geom_aabb + 6 * side.geom + 3;
    const int type = model_->geom_type[side.geom];
    if (type == mjGEOM_CYLINDER)
      least = std::min<double>(least, half[0]);
    else if (is_round_all_over(type) || have_corners())
      least = std::min<double>(least, std::min({half[0], half[1], half[2]}));
  }
  return least;
}

double ContactMotion::turn() const {
  return length_ * std::max(mju_norm3(side_[0].angular), mju_norm3(side_[1].angular));
}

double ContactMotion::way() const {
  const double radius[2] = {model_->geom_rbound[side_[0].geom], model_->geom_rbound[side_[1].geom]};
  const int smaller = radius[1] == 0.0 || (radius[0] > 0.0 && radius[0] < radius[1]) ? 0 : 1;
  const mjtNum* centre = data_->geom_xpos + 3 * side_[smaller].geom;
  mjtNum velocity[2][3];
  for (int i = 0; i < 2; ++i) velocity_of(side_[i], centre, velocity[i]);
  return length_ * mju_dist3(velocity[0], velocity[1]);
}

double ContactMotion::way_in(double time) const {
  double speed = mju_norm3(relative_);
  for (const Side& side : side_)
    speed += mju_norm3(side.angular) * (model_->geom_rbound[side.geom] +
                                        mju_dist3(data_->geom_xpos + 3 * side.geom, side.centre));
  return time * speed;
}

double ContactMotion::gap_rate(const ContactInput& contact) const {
  mjtNum velocity[2][3];
  for (int i = 0; i < 2; ++i) velocity_of(side_[i], contact.acting_point(i).data(), velocity[i]);
  mju_subFrom3(velocity[1], velocity[0]);
  return mju_dot3(contact.frame.data(), velocity[1]);
}

double ContactMotion::inverse_mass(const ContactInput& contact, const Trees& trees) const {
  double sum = 0.0;
  for (int i = 0; i < 2; ++i) {
    const Side& side = side_[i];
    if (!side.is_free) {
      sum += model_->body_invweight0[2 * side.body];
      continue;
    }
    mjtNum arm[3], torque[3];
    mju_sub3(arm, contact.acting_point(i).data(), side.centre);
    mju_cross(torque, arm, contact.frame.data());
    const double* inverse = trees.inverse.data() + trees.tree[contact.tree[i]].inverse;
    sum += inverse[0];
    for (int k = 0; k < 3; ++k) sum += torque[k] * mju_dot3(inverse + 4 * (k + 1), torque);
  }
  return sum;
}

bool ContactMotion::joints_move(int side, double angle) const {
  if (side_[side].is_free) return false;
  for (int dof = last_dof(model_, side_[side].body); dof >= 0; dof = model_->dof_parentid[dof])
    if (length_ * std::abs(data_->qvel[dof]) > angle) return true;
  return false;
}

void ContactMotion::find_twists(double time) {
  for (int i = 0; i < 2; ++i) {
    Side& side = side_[i];
    if (side.is_free) continue;
    twist_ahead(model_, data_, side.body, 0.0, side.twist[0]);
    twist_ahead(model_, data_, side.body, time, side.twist[1]);
  }
}

std::array<double, 3> ContactMotion::point_rate(const ContactInput& contact, When when) const {
  mjtNum relative[3] = {0, 0, 0};
  for (int i = 0; i < 2; ++i) {
    const Side& side = side_[i];
    const mjtNum sign = i == 0 ? -1.0 : 1.0;
    const mjtNum* centre =
        side.is_free ? side.centre : data_->subtree_com + 3 * model_->body_rootid[side.body];
    const mjtNum* twist = side.twist[when == When::kStart ? 0 : 1];
    mjtNum arm[3], velocity[3];
    mju_sub3(arm, contact.acting_point(i).data(), centre);
    mju_cross(velocity, side.is_free ? side.angular : twist, arm);
    mju_addTo3(velocity, side.is_free ? side.linear : twist + 3);
    mju_addToScl3(relative, velocity, sign);
  }
  std::array<double, 3> rate;
  mju_mulMatVec3(rate.data(), contact.frame.data(), relative);
  return rate;
}

void velocity_at(const mjModel* m, const mjData* d, int body, const mjtNum* point, mjtNum* angular,
                 mjtNum* linear) {
  point_velocity(m, d, body, point, linear);
  mju_copy3(angular, d->cvel + 6 * body);
  const mjtNum* carrier = is_fixed(m, body) ? nullptr : mocap_twist(m, d, body);
  if (carrier) mju_addTo3(angular, carrier);
}

MovedGeom::MovedGeom(const mjModel* m, mjData* d, int geom, mjtNum time)
    : position_(d->geom_xpos + 3 * geom), rotation_(d->geom_xmat + 9 * geom) {
  mju_copy3(start_position_, position_);
  mju_copy(start_rotation_, rotation_, 9);
  mjtNum linear[3], quaternion[4], angle[3], turn[9];
  velocity_at(m, d, m->geom_bodyid[geom], position_, angle, linear);
  mju_addToScl3(position_, linear, time);
  mju_scl3(angle, angle, time);
  const mjtNum norm = mju_normalize3(angle);
  mju_axisAngle2Quat(quaternion, angle, norm);
  mju_quat2Mat(turn, quaternion);
  mju_mulMatMat(rotation_, turn, start_rotation_, 3, 3, 3);
}

MovedGeom::~MovedGeom() {
  mju_copy3(position_, start_position_);
  mju_copy(rotation_, start_rotation_, 9);
}

}  // namespace dashpot::host
