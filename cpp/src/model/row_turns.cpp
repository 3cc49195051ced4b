#include "dashpot/model/row_turns.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>

#include "dashpot/model/constraints.hpp"
#include "dashpot/rows/hit.hpp"

namespace dashpot::host {

namespace {

// rad: what rounding turns the axis of a ball joint by that keeps it, and what such a joint, or its
// axis, may turn by in a step: a limit that stops one that turns faster throws it elsewhere than
// its velocity at the start tells.
constexpr double kRoundedTurn = 1e-12, kMostTurn = 0.1;

// Whether a tendon's path goes through space: its row changes as joints move.
bool is_spatial(const mjModel* m, int tendon) {
  return m->wrap_type[m->tendon_adr[tendon]] != mjWRAP_JOINT;
}

// Calls use(tendon) for those that an equality keeps.
template <typename Use>
void for_each_tendon(const mjModel* m, const mjData* d, const ConstraintInput& input, Use use) {
  if (input.kind != RowKind::kBilateral) return;
  const int id = d->efc_id[input.source];
  if (m->eq_type[id] != mjEQ_TENDON) return;
  use(m->eq_obj1id[id]);
  if (m->eq_obj2id[id] >= 0) use(m->eq_obj2id[id]);
}

void read_tendon(const mjModel* m, const mjData* d, const Trees& trees, int tendon, double* row) {
  const int first = m->ten_J_rowadr[tendon];
  for (int k = first; k < first + m->ten_J_rownnz[tendon]; ++k)
    row[m->ten_J_colind[k]] = d->ten_J[k];
  for (const Tree& t : trees.tree)
    if (t.free_body) to_centre(m, d, t, row + t.dof_begin);
}

// What is left of its range falls as it turns on about the axis that it has turned about.
void read_ball(const mjModel* m, const mjData* d, int joint, double* row) {
  mjtNum orientation[4], axis[3];
  mju_copy4(orientation, d->qpos + m->jnt_qposadr[joint]);
  mju_normalize4(orientation);
  mju_quat2Vel(axis, orientation, 1.0);
  mju_normalize3(axis);
  mju_scl3(row + m->jnt_dofadr[joint], axis, -1.0);
}

double rate_of(const Trees& trees, const double* row, const double* motion) {
  double rate = 0.0;
  for (const Tree& t : trees.tree)
    for (int i = 0; i < t.dof_count; ++i)
      rate += row[t.dof_begin + i] * motion[coordinate_of(t, i)];
  return rate;
}

// Whether what is left of a range, `gap`, is used up, or free again, within a step of `length`
// faster than the turn of its row brings it about.
bool is_hit(double gap, double rate, double turning, double length) {
  return std::abs(gap) < length * std::abs(rate) &&
         std::abs(rate) > std::max(kHitSpeed, 2.0 * length * std::abs(turning));
}

}  // namespace

const RowTurns::Turn* RowTurns::find_turn(int ball, int tendon) const {
  for (const Turn& turn : turns_)
    if (turn.ball == ball && turn.tendon == tendon) return &turn;
  return nullptr;
}

void RowTurns::add_turn(const mjModel_* m, int ball, int tendon, double gap) {
  if ((tendon >= 0 && !is_spatial(m, tendon)) || find_turn(ball, tendon)) return;
  turns_.push_back({ball, tendon, static_cast<int>(m->nv * turns_.size()), gap, 0.0});
}

void RowTurns::read_rows(const mjModel_* m, const mjData_* d, const Trees& trees,
                         std::vector<double>& rows) const {
  rows.assign(turns_.size() * m->nv, 0.0);
  for (const Turn& turn : turns_) {
    if (turn.ball >= 0)
      read_ball(m, d, turn.ball, rows.data() + turn.row);
    else
      read_tendon(m, d, trees, turn.tendon, rows.data() + turn.row);
  }
}

void RowTurns::find(const mjModel_* m, mjData_* d, double length, const Trees& trees,
                    const double* motion, const std::vector<ConstraintInput>& constraints) {
  turns_.clear();
  for (const ConstraintInput& input : constraints) {
    if (input.ball >= 0 || input.tendon >= 0)
      add_turn(m, input.ball, input.tendon, input.position);
    else
      for_each_tendon(m, d, input, [&](int tendon) { add_turn(m, -1, tendon, 0.0); });
  }
  if (turns_.empty()) return;
  half_length_ = 0.5 * length;
  read_rows(m, d, trees, start_);
  position_.assign(d->qpos, d->qpos + m->nq);
  mj_integratePos(m, d->qpos, d->qvel, half_length_);
  const bool has_tendons =
      std::any_of(turns_.begin(), turns_.end(), [](const Turn& turn) { return turn.tendon >= 0; });
  if (has_tendons) mj_fwdKinematics(m, d);
  read_rows(m, d, trees, rows_);
  std::copy(position_.begin(), position_.end(), d->qpos);
  if (has_tendons) mj_fwdKinematics(m, d);
  for (Turn& turn : turns_) {
    const double *start = start_.data() + turn.row, *middle = rows_.data() + turn.row;
    const double rate = rate_of(trees, start, motion);
    turn.turning = (rate_of(trees, middle, motion) - rate) / half_length_;
    if (turn.ball < 0) continue;
    const int dof = m->jnt_dofadr[turn.ball];
    const double speed = mju_norm3(d->qvel + dof);
    const double half_turn = mju_dist3(start + dof, middle + dof);
    // Where it has no range, it has not moved, and no row but that of the middle is of its motion.
    const bool has_range = m->jnt_range[2 * turn.ball + 1] > 0.0;
    const bool row_turns_far = has_range && 2.0 * half_turn > kMostTurn;
    if (half_turn < kRoundedTurn || row_turns_far || speed * length > kMostTurn ||
        is_hit(turn.gap, rate, turn.turning, length))
      turn.turning = 0.0;
  }
}

}  // namespace dashpot::host
