#include "dashpot/model/constraints.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "dashpot/model/body_inertia.hpp"
#include "dashpot/model/constraint_memory.hpp"
#include "dashpot/model/errors.hpp"
#include "dashpot/model/jacobians.hpp"
#include "dashpot/model/mocap_bodies.hpp"
#include "dashpot/model/row_turns.hpp"
#include "dashpot/model/springs_and_dampers.hpp"
#include "dashpot/model/trees.hpp"

namespace dashpot::host {

namespace {

struct Range {
  int begin, end;
};

// The degrees of freedom that a row of efc_J may reach: those of its joint, or all.
Range dofs_of_row(const mjModel* m, const mjData* d, int row) {
  const int id = d->efc_id[row];
  if (d->efc_type[row] == mjCNSTR_FRICTION_DOF) return {id, id + 1};
  if (d->efc_type[row] != mjCNSTR_LIMIT_JOINT) return {0, static_cast<int>(m->nv)};
  const int first = m->jnt_dofadr[id];
  return {first, first + (m->jnt_type[id] == mjJNT_BALL ? 3 : 1)};
}

// Calls visit(dof, value) for every nonzero of a row of efc_J, or of a damper.
template <typename Visit>
void for_each_nonzero(const mjModel* m, const mjData* d, int row, Visit visit) {
  if (row < 0) {
    const SparseRow damper = damper_row(m, d, row);
    for (int k = 0; k < damper.count; ++k)
      if (damper.value[k] != 0.0) visit(damper.dof[k], damper.value[k]);
  } else if (mj_isSparse(m)) {
    const int address = d->efc_J_rowadr[row];
    for (int k = address; k < address + d->efc_J_rownnz[row]; ++k)
      if (d->efc_J[k] != 0.0) visit(d->efc_J_colind[k], d->efc_J[k]);
  } else {
    const Range dofs = dofs_of_row(m, d, row);
    for (int dof = dofs.begin; dof < dofs.end; ++dof)
      if (d->efc_J[row * m->nv + dof] != 0.0) visit(dof, d->efc_J[row * m->nv + dof]);
  }
}

// The parameters of a constraint in its model arrays.
struct Source {
  RowKind kind;
  int memory;
  const mjtNum* solref;
  const mjtNum* solimp;
  double margin;
};

// Whether row `index` of an object has the impedance of the one before it, since that goes by the
// norm of the positions of both; of welds, as in MuJoCo, metres and radians together.
bool has_one_impedance(const mjModel* m, const mjData* d, int row, int index) {
  if (d->efc_type[row] != mjCNSTR_EQUALITY) return false;
  const int type = m->eq_type[d->efc_id[row]];
  return index > 0 && (type == mjEQ_CONNECT || type == mjEQ_WELD);
}

// Whether a row of a limit is that of its upper side: the one whose gap it has, and, where both
// have the same, the second of its rows. A ball joint has one side.
bool is_upper_side(const mjModel* m, const mjData* d, int row, int index) {
  const int id = d->efc_id[row];
  const bool of_joint = d->efc_type[row] == mjCNSTR_LIMIT_JOINT;
  if (of_joint && m->jnt_type[id] == mjJNT_BALL) return false;
  const mjtNum value = of_joint ? d->qpos[m->jnt_qposadr[id]] : d->ten_length[id];
  const mjtNum* const range = (of_joint ? m->jnt_range : m->tendon_range) + 2 * id;
  const mjtNum lower = value - range[0], upper = range[1] - value, gap = d->efc_pos[row];
  return index > 0 || std::abs(gap - upper) < std::abs(gap - lower);
}

// `index` counts the rows of the same object from 0; `upper` tells the two sides of a limit.
Source source_of(const mjModel* m, int type, int id, int index, bool upper) {
  switch (type) {
    case mjCNSTR_EQUALITY: {
      if (index >= equality_rows(m, id))
        throw std::invalid_argument("equality #" + std::to_string(id) +
                                    " has more rows than there is memory for");
      return {RowKind::kBilateral, memory_of_equality(m, id) + index, m->eq_solref + mjNREF * id,
              m->eq_solimp + mjNIMP * id, 0.0};
    }
    case mjCNSTR_FRICTION_DOF:
      return {RowKind::kSlider, memory_of_friction(m, id), m->dof_solref + mjNREF * id,
              m->dof_solimp + mjNIMP * id, 0.0};
    case mjCNSTR_FRICTION_TENDON:
      return {RowKind::kSlider, memory_of_tendon_friction(m, id),
              m->tendon_solref_fri + mjNREF * id, m->tendon_solimp_fri + mjNIMP * id, 0.0};
    case mjCNSTR_LIMIT_JOINT:
      return {RowKind::kUnilateral, memory_of_joint_limit(m, id) + upper,
              m->jnt_solref + mjNREF * id, m->jnt_solimp + mjNIMP * id, m->jnt_margin[id]};
    default:
      return {RowKind::kUnilateral, memory_of_tendon_limit(m, id) + upper,
              m->tendon_solref_lim + mjNREF * id, m->tendon_solimp_lim + mjNIMP * id,
              m->tendon_margin[id]};
  }
}

}  // namespace

void to_centre(const mjModel_* m, const mjData_* d, const Tree& t, double* row) {
  const int body = m->dof_bodyid[t.dof_begin];
  mjtNum arm[3], turn[3], angular[3];
  mju_sub3(arm, centre_of_motion(m, d, body), d->xpos + 3 * body);
  mju_cross(turn, arm, row);
  mju_mulMatVec3(angular, d->xmat + 9 * body, row + 3);
  mju_sub3(row + 3, angular, turn);
}

bool is_default_impedance(const double* solref, const double* solimp) {
  struct Default {
    mjtNum solref[mjNREF], solimp[mjNIMP];
    Default() { mj_defaultSolRefImp(solref, solimp); }
  };
  static const Default impedance;
  return std::equal(solref, solref + mjNREF, impedance.solref) &&
         std::equal(solimp, solimp + mjNIMP, impedance.solimp);
}

std::array<int, 2> trees_of_row(const mjModel_* m, const mjData_* d, int source) {
  std::array<int, 2> trees{-1, -1};
  int count = 0;
  for_each_nonzero(m, d, source, [&](int dof, double) {
    const int tree = m->dof_treeid[dof];
    if (tree == trees[0] || tree == trees[1]) return;
    if (count == 2)
      throw std::invalid_argument(
          constraint_name(m, d, source) +
          " couples more than two kinematic trees, which are one tree in an Engine made of the "
          "model as it is now; make a new one");
    trees[count++] = tree;
  });
  return trees;
}

void read_constraints(const mjModel_* m, const mjData_* d,
                      std::vector<ConstraintInput>& constraints) {
  constraints.clear();
  int index = 0;     // of the rows of one object
  size_t first = 0;  // of them in `constraints`
  for (int row = 0; row < d->ne + d->nf + d->nl; ++row) {
    const int type = d->efc_type[row], id = d->efc_id[row];
    const bool goes_on = row > 0 && d->efc_type[row - 1] == type && d->efc_id[row - 1] == id;
    index = goes_on ? index + 1 : 0;
    if (!has_one_impedance(m, d, row, index)) first = constraints.size();
    ConstraintInput input;
    input.tree = trees_of_row(m, d, row);
    if (input.tree[0] < 0) continue;
    const bool is_limit = type == mjCNSTR_LIMIT_JOINT || type == mjCNSTR_LIMIT_TENDON;
    const bool upper = is_limit && is_upper_side(m, d, row, index);
    const Source source = source_of(m, type, id, index, upper);
    input.kind = source.kind;
    input.source = row;
    input.memory = source.memory;
    input.position = source.kind == RowKind::kSlider ? 0.0 : d->efc_pos[row] - source.margin;
    input.is_joint_limit = type == mjCNSTR_LIMIT_JOINT;
    if (input.is_joint_limit && m->jnt_type[id] == mjJNT_BALL) input.ball = id;
    if (type == mjCNSTR_LIMIT_TENDON) input.tendon = id;
    if (upper) input.side = -1.0;
    input.limit = d->efc_frictionloss[row];
    std::copy_n(source.solref, 2, input.solref.begin());
    std::copy_n(source.solimp, input.solimp.size(), input.solimp.begin());
    input.is_of_mocap = type == mjCNSTR_EQUALITY && is_held_by_mocap(m, id);
    input.has_solref = !is_default_impedance(source.solref, source.solimp) || input.is_of_mocap;
    if (first < constraints.size()) {
      ++constraints[first].together;
      input.together = 0;
    }
    constraints.push_back(input);
  }
}

void append_rows(const mjModel_* m, const mjData_* d, int source, const Trees& trees, Rows& rows) {
  RowGroup& c = rows.group.back();
  const auto is_free_body = [&](int tree) { return tree >= 0 && trees.tree[tree].free_body; };
  if (c.dim == 1 && c.tree[1] < 0 && !is_free_body(c.tree[0])) {
    const Tree& t = trees.tree[c.tree[0]];
    for_each_nonzero(m, d, source, [&](int dof, double value) {
      rows.column.push_back(t.begin + dof - t.dof_begin);
      rows.value.push_back(value);
    });
    c.columns[0] = static_cast<int>(rows.column.size()) - c.column;
    return;
  }
  // `dim` rows over the degrees of freedom of each tree; kept by the thread, as everything that a
  // step needs is: it allocates nothing.
  thread_local std::vector<double> dense[2];
  int begin[2] = {}, count[2] = {};  // of the range that they reach
  for (int side = 0; side < 2; ++side) {
    if (c.tree[side] < 0) continue;
    const Tree& t = trees.tree[c.tree[side]];
    int end = t.free_body ? t.dof_count : 0;
    begin[side] = t.free_body ? 0 : t.dof_count;
    const auto for_each = [&](int i, const auto& visit) {
      for_each_nonzero(m, d, source + i, [&](int dof, double value) {
        if (m->dof_treeid[dof] == c.tree[side]) visit(dof - t.dof_begin, value);
      });
    };
    for (int i = 0; i < c.dim; ++i)
      for_each(i, [&](int dof, double) {
        begin[side] = std::min(begin[side], dof);
        end = std::max(end, dof + 1);
      });
    count[side] = std::max(0, end - begin[side]);
    dense[side].assign(c.dim * count[side], 0.0);
    for (int i = 0; i < c.dim; ++i) {
      double* row = dense[side].data() + i * count[side];
      for_each(i, [&](int dof, double value) { row[dof - begin[side]] = value; });
      if (t.free_body) to_centre(m, d, t, row);
    }
    for (int j = begin[side]; j < end; ++j) {
      bool any = false;
      for (int i = 0; i < c.dim; ++i)
        any = any || dense[side][i * count[side] + j - begin[side]] != 0.0;
      if (!any) continue;
      rows.column.push_back(t.begin + (t.free_body && j >= 3 ? j + 1 : j));
      ++c.columns[side];
    }
  }
  const int* column = rows.column.data() + c.column;
  for (int i = 0; i < c.dim; ++i)
    for (int k = 0; k < c.width(); ++k) {
      const int side = k < c.columns[0] ? 0 : 1;
      const Tree& t = trees.tree[c.tree[side]];
      const int coordinate = column[k] - t.begin;
      const int dof = t.free_body && coordinate > 3 ? coordinate - 1 : coordinate;
      rows.value.push_back(dense[side][i * count[side] + dof - begin[side]]);
    }
}

void append_limit_in_the_middle(const ConstraintInput& input, const Trees& trees,
                                const RowTurns& turns, Rows& rows) {
  RowGroup& c = rows.group.back();
  const double* row = turns.limit_in_the_middle(input);
  c.ahead = turns.half_length();
  c.turning[0] = input.side * turns.limit_turning(input);
  for (int side = 0; side < 2; ++side) {
    if (c.tree[side] < 0) continue;
    const Tree& t = trees.tree[c.tree[side]];
    for (int i = 0; i < t.dof_count; ++i) {
      if (row[t.dof_begin + i] == 0.0) continue;
      rows.column.push_back(coordinate_of(t, i));
      rows.value.push_back(input.side * row[t.dof_begin + i]);
      ++c.columns[side];
    }
  }
}

void append_jacobian(const mjModel_* m, const mjData_* d, const ConstraintInput& input,
                     const Trees& trees, const RowTurns& turns, Rows& rows) {
  if (turns.limit_in_the_middle(input))
    return append_limit_in_the_middle(input, trees, turns, rows);
  append_rows(m, d, input.source, trees, rows);
  if (input.drive != 0.0) return append_ground_motion(rows, kSurfaceCoordinate, &input.drive);
  if (input.kind != RowKind::kBilateral) return;
  const int equality = d->efc_id[input.source];
  const int row = input.memory - memory_of_equality(m, equality);
  const double turning = turning_of_equality(m, d, equality, row, trees, turns);
  if (turning != 0.0) append_ground_motion(rows, kTurningCoordinate, &turning);
}

double typical_inverse_mass(const mjModel_* m, const mjData_* d, const ConstraintInput& input) {
  if (input.source < 0) return damper_inverse_mass(m, input.source);
  const double of_mujoco = d->efc_diagA[input.source];
  // MuJoCo adds the inverse masses of both objects whatever the slope: of a screw, metres by
  // radians, thousands of times what moves. What the model's own solref stands for goes by that.
  if (d->efc_type[input.source] != mjCNSTR_EQUALITY || input.has_solref) return of_mujoco;
  const int equality = d->efc_id[input.source], type = m->eq_type[equality];
  if (type != mjEQ_JOINT && type != mjEQ_TENDON) return of_mujoco;
  const auto inverse_mass = [&](int object) {
    if (object < 0) return 0.0;
    return type == mjEQ_JOINT ? m->dof_invweight0[m->jnt_dofadr[object]]
                              : m->tendon_invweight0[object];
  };
  const double slope = slope_of_equality(m, d, equality);
  return inverse_mass(m->eq_obj1id[equality]) +
         slope * slope * inverse_mass(m->eq_obj2id[equality]);
}

}  // namespace dashpot::host
