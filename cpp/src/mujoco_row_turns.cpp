#include "dashpot/mujoco_row_turns.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>

#include "dashpot/mujoco_constraints.hpp"

namespace dashpot::host {

namespace {

// Whether a tendon's path goes through space: its row changes as joints move.
bool is_spatial(const mjModel* m, int tendon) {
  return m->wrap_type[m->tendon_adr[tendon]] != mjWRAP_JOINT;
}

// Calls use(tendon) for those that a limit or an equality keeps.
template <typename Use>
void for_each_tendon(const mjModel* m, const mjData* d, const ConstraintInput& input, Use use) {
  const int id = d->efc_id[input.source];
  if (input.tendon >= 0) return use(input.tendon);
  if (input.kind != RowKind::kBilateral || m->eq_type[id] != mjEQ_TENDON) return;
  use(m->eq_obj1id[id]);
  if (m->eq_obj2id[id] >= 0) use(m->eq_obj2id[id]);
}

}  // namespace

const RowTurns::Turn* RowTurns::find_turn(int tendon) const {
  for (const Turn& turn : turns_)
    if (turn.tendon == tendon) return &turn;
  return nullptr;
}

void RowTurns::read_row(const mjModel_* m, const mjData_* d, const Trees& trees, int tendon,
                        double* row) {
  std::fill_n(row, m->nv, 0.0);
  const int first = m->ten_J_rowadr[tendon];
  for (int k = first; k < first + m->ten_J_rownnz[tendon]; ++k)
    row[m->ten_J_colind[k]] = d->ten_J[k];
  for (const Tree& t : trees.tree)
    if (t.free_body) to_centre(m, d, t, row + t.dof_begin);
}

void RowTurns::find(const mjModel_* m, mjData_* d, double length, const Trees& trees,
                    const double* motion, const std::vector<ConstraintInput>& constraints) {
  turns_.clear();
  if (m->ntendon == 0) return;
  for (const ConstraintInput& input : constraints)
    for_each_tendon(m, d, input, [&](int tendon) {
      if (is_spatial(m, tendon) && !find_turn(tendon))
        turns_.push_back({tendon, static_cast<int>(m->nv * turns_.size()), 0.0});
    });
  if (turns_.empty()) return;
  half_length_ = 0.5 * length;
  rows_.resize(turns_.size() * m->nv);
  start_.resize(rows_.size());
  for (const Turn& turn : turns_) read_row(m, d, trees, turn.tendon, start_.data() + turn.row);
  position_.assign(d->qpos, d->qpos + m->nq);
  mj_integratePos(m, d->qpos, d->qvel, half_length_);
  mj_fwdKinematics(m, d);
  for (const Turn& turn : turns_) read_row(m, d, trees, turn.tendon, rows_.data() + turn.row);
  std::copy(position_.begin(), position_.end(), d->qpos);
  mj_fwdKinematics(m, d);
  for (Turn& turn : turns_)
    for (const Tree& t : trees.tree)
      for (int i = 0; i < t.dof_count; ++i) {
        const int at = turn.row + t.dof_begin + i;
        turn.turning += (rows_[at] - start_[at]) / half_length_ * motion[coordinate_of(t, i)];
      }
}

}  // namespace dashpot::host
