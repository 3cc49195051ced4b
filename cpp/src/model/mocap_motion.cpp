#include "dashpot/model/mocap_motion.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "dashpot/model/constraint_memory.hpp"
#include "dashpot/model/constraints.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/model/sleep.hpp"

namespace dashpot::host {

namespace {

constexpr double kSliver = 1e-9;  // of a substep, by which sums of lengths are off

MocapVector times(double factor, const MocapVector& v) {
  return {factor * v[0], factor * v[1], factor * v[2]};
}

// The way within a part of `length` up to a time.
MocapVector way(double time, double length, const MocapVector& mean,
                const MocapVector& acceleration) {
  MocapVector sum = times(time, mean);
  mju_addToScl3(sum.data(), acceleration.data(), 0.5 * time * (time - length));
  return sum;
}
bool all_zero(const MocapVector& v) { return v == MocapVector{}; }

bool is_in_motion(const MocapBody& body) {
  return !all_zero(body.velocity) || !all_zero(body.angular) || !all_zero(body.acceleration) ||
         !all_zero(body.angular_acceleration);
}

bool has_arrived(const RememberedMocap& mocap) {
  return mocap.pose == mocap.command && all_zero(mocap.velocity) && all_zero(mocap.angular);
}

bool rests(const RememberedMocap& mocap) {
  return has_arrived(mocap) && all_zero(mocap.mean.velocity) && all_zero(mocap.mean.change) &&
         all_zero(mocap.mean.growth) && all_zero(mocap.mean_angular.velocity) &&
         all_zero(mocap.mean_angular.change) && all_zero(mocap.mean_angular.growth);
}

}  // namespace

const std::vector<int>& MocapBuffers::find_bodies(const mjModel_* m) {
  if (of_body.empty()) {
    id = driven_bodies(m);
    std::vector<int> of_root(m->nbody, -1);
    for (size_t i = 0; i < id.size(); ++i) of_root[id[i]] = static_cast<int>(i);
    for (int i = 0; i < m->nbody; ++i) of_body.push_back(of_root[m->body_rootid[i]]);
  }
  return id;
}

MocapMotion::MocapMotion(const mjModel_* m, mjData_* d, bool moves, double time_constant,
                         const Memory& memory, MocapBuffers& buffers)
    : model_(m),
      data_(d),
      moves_(moves),
      time_constant_(time_constant),
      buffers_(buffers),
      places_(m, d, buffers.find_bodies(m), buffers.active, buffers.place) {
  buffers.body.resize(buffers.id.size());
  buffers.active.clear();
  buffers.jumped.clear();
  const size_t count = moves ? buffers.id.size() : m->nmocap;
  for (size_t i = 0; i < count; ++i) {
    const int index = static_cast<int>(i);
    const RememberedMocap remembered = memory.mocap(index);
    MocapBody& body = buffers.body[i];
    MocapPose command = places_.pose(i);
    body.rests = moves && remembered.command == command && rests(remembered);
    if (body.rests) continue;
    body = {remembered};
    buffers.active.push_back(i);
    places_.start(i);
    mju_normalize4(command.data() + 3);
    const bool knows = moves && is_known(body.now);
    const bool far = knows && is_far(m, body.now.command, command);
    const bool may_follow = moves && time_constant > 0.0 && holds_anything(m, d, index);
    body.settles = (far || !knows) && may_follow;
    if (far && !may_follow) buffers.jumped.push_back(buffers.id[i]);
    if (!knows || (far && !may_follow)) body.now = at_rest(command);
    if (body.now.command != command) tell(m, d->time, command, may_follow, time_constant, body.now);
  }
}

bool MocapMotion::anything_moves() const {
  return std::any_of(buffers_.active.begin(), buffers_.active.end(),
                     [&](size_t i) { return is_in_motion(buffers_.body[i]); });
}

bool MocapMotion::moves(int geom) const {
  if (geom < 0 || buffers_.active.empty()) return false;
  const MocapBody* body = carrier_of(model_->geom_bodyid[geom]);
  return body && is_in_motion(*body);
}

// Null of what nothing carries that is not at rest.
const MocapBody* MocapMotion::carrier_of(int id) const {
  const int index = buffers_.of_body[id];
  return index < 0 || buffers_.body[index].rests ? nullptr : &buffers_.body[index];
}

void MocapMotion::begin(double length) {
  searched_ = length_ = length;
  for (size_t i : buffers_.active) {
    MocapBody& body = buffers_.body[i];
    if (body.settles) settle(model_, data_, i, places_, body.now);
    body.settles = false;
  }
  for (size_t i : buffers_.active) {
    find_mean_velocity(length, buffers_.body[i]);
    if (first_substep_) find_acceleration(length, i);
  }
  first_substep_ = false;
  buffers_.end_position.clear();
  buffers_.drive.clear();
  if (anything_moves() && (model_->neq > 0 || model_->ntendon > 0)) find_constraints(length);
  show(0.0);
}

void MocapMotion::find_mean_velocity(double length, MocapBody& body) const {
  const RememberedMocap& now = body.now;
  body.velocity = body.angular = {};
  if (has_arrived(now)) return;
  if (now.left > 0.0) {
    const double rate = 1.0 / std::max(length, now.left);
    body.velocity = times(rate, offset(now.pose, now.command));
    body.angular = times(rate, turn(now.pose, now.command));
    return;
  }
  MocapVector x = offset(now.command, now.pose), angle = turn(now.command, now.pose);
  MocapVector rate = now.velocity, angular_rate = now.angular;
  follow(time_constant_, length, x, rate);
  follow(time_constant_, length, angle, angular_rate);
  MocapPose end = now.command;
  move(end, x, angle);
  body.velocity = times(1.0 / length, offset(now.pose, end));
  body.angular = times(1.0 / length, turn(now.pose, end));
}

// The acceleration in a step of `length`. Equalities see none (drive()), so what they hold to,
// which has to be where they see it when the step ends early, has none.
void MocapMotion::find_acceleration(double length, size_t index) {
  MocapBody& body = buffers_.body[index];
  RememberedMocap& now = body.now;
  const double between = 0.5 * (length + now.length);
  body.acceleration = accelerate(body.velocity, between, now.mean);
  body.angular_acceleration = accelerate(body.angular, between, now.mean_angular);
  now.length = length;
  if (holds_anything(model_, data_, static_cast<int>(index)))
    body.acceleration = body.angular_acceleration = {};
}

void MocapMotion::shorten(double length) {
  if (length == length_) return;
  const double earlier = 0.5 * (length - length_);
  for (size_t index : buffers_.active) {
    MocapBody& body = buffers_.body[index];
    mju_addToScl3(body.velocity.data(), body.acceleration.data(), earlier);
    mju_addToScl3(body.angular.data(), body.angular_acceleration.data(), earlier);
  }
  length_ = length;
  write_velocities();
}

void MocapMotion::show(double time) {
  for (size_t i : buffers_.active) {
    const MocapBody& body = buffers_.body[i];
    MocapPose pose = has_arrived(body.now) ? places_.given(i) : body.now.pose;
    if (time > 0.0 && is_in_motion(body))
      move(pose, way(time, length_, body.velocity, body.acceleration),
           way(time, length_, body.angular, body.angular_acceleration));
    places_.put(i, pose);
  }
  if (may_sleep(model_)) places_.update_fixed_bodies();
}

// The positions of all constraints with mocap bodies at the end of their way, others as they are.
void MocapMotion::find_constraints(double length) {
  show(length);
  data_->ncon = 0;
  data_->parena = 0;  // what the last step left there is not needed any more
  mj_fwdKinematics(model_, data_);
  mj_makeConstraint(model_, data_);
  read_constraints(model_, data_, buffers_.constraints);
  buffers_.end_position.assign(constraint_memory_count(model_),
                               std::numeric_limits<double>::quiet_NaN());
  for (const ConstraintInput& c : buffers_.constraints)
    if (c.kind != RowKind::kSlider) buffers_.end_position[c.memory] = c.position;
}

void MocapMotion::write_velocities() const {
  if (!anything_moves()) return;
  for (int id = 0; id < model_->nbody; ++id) {
    const MocapBody* carrier = is_fixed(model_, id) ? carrier_of(id) : nullptr;
    if (!carrier) continue;
    const MocapBody& body = *carrier;
    const int root = model_->body_rootid[id];
    mjtNum arm[3], around[3];
    mju_sub3(arm, data_->subtree_com + 3 * root, data_->xpos + 3 * root);
    mju_cross(around, body.angular.data(), arm);
    mjtNum* rate = data_->cvel + 6 * id;
    std::copy_n(body.angular.begin(), 3, rate);
    mju_add3(rate + 3, body.velocity.data(), around);
  }
}

void MocapMotion::drive(std::vector<ConstraintInput>& constraints) {
  if (buffers_.end_position.empty()) return;
  if (buffers_.drive.empty()) {
    buffers_.drive.assign(buffers_.end_position.size(), 0.0);
    for (const ConstraintInput& c : constraints)
      if (const double end = c.memory < 0 ? NAN : buffers_.end_position[c.memory]; !std::isnan(end))
        buffers_.drive[c.memory] = (end - c.position) / searched_;
  }
  for (ConstraintInput& c : constraints)
    if (c.memory >= 0) c.drive = buffers_.drive[c.memory];
}

void MocapMotion::drive(std::vector<ContactInput>& contacts) const {
  for (ContactInput& contact : contacts) {
    contact.surface_acceleration = {};
    for (int side = 0; side < 2; ++side)
      if (contact.geom[side] >= 0 && !buffers_.active.empty())
        add_acceleration(contact.geom[side], contact.position, side ? 1.0 : -1.0,
                         contact.surface_acceleration);
  }
}

// Adds the acceleration of a point of a geom, times `sign`, with which a mocap body takes it along.
void MocapMotion::add_acceleration(int geom, const MocapVector& position, double sign,
                                   MocapVector& acceleration) const {
  const int id = model_->geom_bodyid[geom];
  const MocapBody* body = carrier_of(id);
  if (!body) return;
  mjtNum arm[3], around[3];
  mju_sub3(arm, position.data(), data_->xpos + 3 * model_->body_rootid[id]);
  mju_cross(around, body->angular_acceleration.data(), arm);
  mju_addTo3(around, body->acceleration.data());
  mju_addToScl3(acceleration.data(), around, sign);
}

double MocapMotion::work_against_gravity(double length) const {
  double work = 0.0;
  if (!anything_moves() || model_->opt.disableflags & mjDSBL_GRAVITY) return work;
  for (size_t i : buffers_.active) {
    const int id = buffers_.id[i];
    const MocapBody& body = buffers_.body[i];
    mjtNum arm[3], turned[3], turn[4] = {1, 0, 0, 0};
    mju_sub3(arm, data_->subtree_com + 3 * id, data_->xpos + 3 * id);
    rotate(turn, times(length, body.angular));
    mju_rotVecQuat(turned, arm, turn);
    for (int axis = 0; axis < 3; ++axis)
      work -= model_->body_subtreemass[id] * model_->opt.gravity[axis] *
              (length * body.velocity[axis] + turned[axis] - arm[axis]);
  }
  return work;
}

void MocapMotion::advance(double length) {
  for (size_t i : buffers_.active) {
    const MocapBody& body = buffers_.body[i];
    RememberedMocap& now = buffers_.body[i].now;
    if (has_arrived(now) && !is_in_motion(body)) continue;
    if (now.left > 0.0) {
      move(now.pose, times(length, body.velocity), times(length, body.angular));
      now.velocity = body.velocity;
      now.angular = body.angular;
      now.left -= length;
      if (now.left > kSliver * length) continue;
      now.pose = now.command;
      now.velocity = now.angular = {};
      now.left = 0.0;
      continue;
    }
    MocapVector x = offset(now.command, now.pose), angle = turn(now.command, now.pose);
    follow(time_constant_, length, x, now.velocity);
    follow(time_constant_, length, angle, now.angular);
    move(now.pose, times(length, body.velocity), times(length, body.angular));
    if (length == searched_ && all_zero(x) && all_zero(angle)) now.pose = now.command;
  }
}

void MocapMotion::remember(Memory& memory) const {
  for (size_t i : buffers_.active)
    memory.set_mocap(static_cast<int>(i), moves_ ? buffers_.body[i].now : RememberedMocap{});
}

}  // namespace dashpot::host
