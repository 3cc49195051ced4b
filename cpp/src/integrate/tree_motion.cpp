#include "dashpot/integrate/tree_motion.hpp"

#include <algorithm>
#include <cmath>
#include <string>

#include "dashpot/model/checks.hpp"
#include "dashpot/model/effective_inertia.hpp"
#include "dashpot/model/forces.hpp"
#include "dashpot/model/host.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/model/sleep.hpp"
#include "dashpot/model/springs_and_dampers.hpp"
#include "dashpot/model/state.hpp"
#include "dashpot/model/trees.hpp"

namespace dashpot {

namespace {

constexpr int kTreesAtOnce = 8, kInvertedAtOnce = 2;  // by a thread

}  // namespace

TreeMotion::TreeMotion(const mjModel_* model, bool own)
    : model_(model), own_(own), trees_(host::make_trees(model)) {}

void TreeMotion::start(const mjData_* d, bool may_have_rows) {
  const double* q = host::position(d);
  const double* v = host::velocity(d);
  start_position_.assign(q, q + host::position_count(model_));
  start_velocity_.assign(v, v + host::dof_count(model_));
  moves_links_ = own_ && may_have_rows;
  any_by_mujoco_ = !own_;
  for (int index = 0; index < tree_count() && !moves_links_; ++index)
    any_by_mujoco_ = any_by_mujoco_ || !host::is_free_body(model_, index);
}

bool TreeMotion::is_accurate(int tree) const { return own_ && host::is_free_body(model_, tree); }

void TreeMotion::find_smooth_motion(mjData_* d, double length, bool rough, RowData& data,
                                    Team& team) {
  find_sleeping(d);
  host::prepare_effective_inertia(model_, d, trees_);
  host::read_welded_parts(model_, tree_count(), parts_, team);
  host::find_effective_inertia(model_, d, parts_, trees_, team);
  host::find_joint_springs(model_, trees_);
  data.reset_motion(trees_.coordinates);
  free_motion_.resize(trees_.tree.size());
  smooth_acceleration_.resize(start_velocity_.size());
  inverted_.resize(trees_.tree.size());
  to_invert_.clear();
  team.for_each(tree_count(), kTreesAtOnce, [&](int index) {
    const Tree& tree = trees_.tree[index];
    double* acceleration = smooth_acceleration_.data() + tree.dof_begin;
    inverted_[index] = tree.free_body;
    if (sleeps(index)) return stay(index, data);
    host::smooth_acceleration(model_, d, trees_, index, acceleration);
    if (host::is_free_body(model_, index)) {
      FreeMotion& motion = free_motion_[index];
      const host::WeldedParts* parts = host::parts_of(model_, parts_, index);
      motion = predict_free_motion(host::read_free_body(model_, d, index, parts, acceleration),
                                   length, rough);
      if (is_accurate(index))
        Eigen::Map<Vector6>(acceleration, 6) = mean_acceleration(motion, length);
    }
    to_coordinates(index, acceleration, data.smooth_acceleration.data() + tree.begin);
    to_coordinates(index, start_velocity_.data() + tree.dof_begin,
                   data.velocity.data() + tree.begin);
  });
  if (own_) load_from_springs(d, length, data);
  data.start_motion = data.velocity;
  for (size_t i = 0; i < smooth_acceleration_.size(); ++i)
    if (!(std::abs(smooth_acceleration_[i]) <= host::kLargestValue))
      throw DivergenceError("smooth acceleration of degree of freedom " + std::to_string(i) +
                            " diverged; data are as they were before the step");
}

void TreeMotion::find_sleeping(const mjData_* d) {
  const bool any = host::any_sleeps(model_, d);
  sleeps_.resize(trees_.tree.size());
  linked_.resize(trees_.tree.size());
  for (int index = 0; index < tree_count(); ++index) {
    sleeps_[index] = any && host::sleeps(d, index);
    linked_[index] = moves_links_ && !sleeps_[index] && !host::is_free_body(model_, index);
  }
}

void TreeMotion::stay(int index, RowData& data) {
  const Tree& tree = trees_.tree[index];
  std::fill_n(smooth_acceleration_.begin() + tree.dof_begin, tree.dof_count, 0.0);
  std::fill_n(data.smooth_acceleration.begin() + tree.begin, tree.count, 0.0);
  std::fill_n(data.velocity.begin() + tree.begin, tree.count, 0.0);
}

// Puts the load of the middle of the step on the free bodies that springs act on.
void TreeMotion::load_from_springs(const mjData_* d, double length, RowData& data) {
  elastic_forces_.find(model_, d, length);
  for (int index = 0; index < tree_count(); ++index) {
    if (!is_sprung(index) || sleeps(index)) continue;
    const Tree& tree = trees_.tree[index];
    double* acceleration = smooth_acceleration_.data() + tree.dof_begin;
    add_load(free_motion_[index], length, elastic_forces_.change(model_, d, index));
    Eigen::Map<Vector6>(acceleration, 6) = mean_acceleration(free_motion_[index], length);
    to_coordinates(index, acceleration, data.smooth_acceleration.data() + tree.begin);
  }
}

bool TreeMotion::is_sprung(int index) const {
  return is_accurate(index) && elastic_forces_.act_on(index);
}

void TreeMotion::freeze_at_middle(mjData_* d, double length, RowData& data, Team& team) {
  host::find_effective_inertia(model_, d, parts_, trees_, team);
  data.velocity[kTurningCoordinate] = -0.5 * length;
  for (int index = 0; index < tree_count(); ++index) {
    const Tree& tree = trees_.tree[index];
    double* acceleration = smooth_acceleration_.data() + tree.dof_begin;
    Vector6 of_free_body;
    const double* velocity = start_velocity_.data() + tree.dof_begin;
    inverted_[index] = tree.free_body;
    if (sleeps(index)) continue;
    if (is_accurate(index)) {
      FreeMotion& motion = free_motion_[index];
      freeze_at(motion, host::orientation(model_, d, index));
      Eigen::Map<Vector6>(acceleration, 6) = mean_acceleration(motion, length);
      of_free_body = dashpot::start_velocity(motion);
      velocity = of_free_body.data();
    }
    to_coordinates(index, acceleration, data.smooth_acceleration.data() + tree.begin);
    to_coordinates(index, velocity, data.velocity.data() + tree.begin);
  }
  data.start_motion = data.velocity;
}

void TreeMotion::freeze_ahead(int index, double time) {
  FreeMotion& motion = free_motion_[index];
  const Eigen::Quaterniond turn = rotation_of(time * motion.angular_velocity);
  freeze_at(motion, (turn * motion.start.orientation).normalized());
  // Columns four apart, see Trees::inverse.
  using Inverse = Eigen::Map<Eigen::Matrix3d, 0, Eigen::OuterStride<4>>;
  Inverse inverse(trees_.inverse.data() + trees_.tree[index].inverse + 4);
  const Eigen::Matrix3d rotation = turn.toRotationMatrix();
  inverse = (rotation * inverse * rotation.transpose()).eval();
}

double TreeMotion::translation_by_turning(const mjData_* d, int index) {
  const Tree& tree = trees_.tree[index];
  const double* velocity = start_velocity_.data() + tree.dof_begin;
  const double* factor = trees_.factor.data() + tree.inverse;
  std::vector<double>& acceleration = displacement_;
  acceleration.resize(tree.dof_count);
  for (int i = 0; i < tree.dof_count; ++i) {
    const int dof = tree.dof_begin + i;
    acceleration[i] = host::positional_force(d, dof) - host::potential_force(model_, d, dof);
  }
  solve_inertia(trees_, index, factor, acceleration.data());
  for (int i = 0; i < tree.dof_count; ++i)
    if (host::is_rotational(model_, tree.dof_begin + i)) acceleration[i] = 0.0;
  return std::sqrt(inertia_form(trees_, index, factor, acceleration.data()) /
                   inertia_form(trees_, index, factor, velocity));
}

void TreeMotion::damp_in_microsteps(const mjData_* d, int index, bool is_held) {
  if (inverted_[index]) return;
  host::damp_in_microsteps(model_, d, index, is_held, trees_);
}

void TreeMotion::spring_in_microsteps(int index) {
  Tree& t = trees_.tree[index];
  if (t.elastic) return;
  const auto first = trees_.stiffness.begin() + t.begin;
  t.sprung = std::any_of(first, first + t.count, [](double stiffness) { return stiffness != 0.0; });
}

void TreeMotion::invert_inertia(const mjData_* d, int tree) {
  if (inverted_[tree]) return;
  fill_inverse(d, tree);
  inverted_[tree] = 1;
}

void TreeMotion::ask_for_inverse(const std::array<int, 2>& trees) {
  for (int tree : trees)
    if (tree >= 0 && !inverted_[tree]) {
      inverted_[tree] = 1;
      to_invert_.push_back(tree);
    }
}

void TreeMotion::invert_inertia(const mjData_* d, Team& team) {
  team.for_each(static_cast<int>(to_invert_.size()), kInvertedAtOnce,
                [&](int i) { fill_inverse(d, to_invert_[i]); });
  to_invert_.clear();
}

void TreeMotion::fill_inverse(const mjData_* d, int tree) {
  host::find_coupled_inertia(model_, d, tree, trees_);
  dashpot::invert_inertia(trees_, tree, trees_.factor.data() + trees_.tree[tree].inverse);
}

void TreeMotion::to_coordinates(int index, const double* generalized, double* coordinates) const {
  const Tree& tree = trees_.tree[index];
  if (!tree.free_body) {
    std::copy_n(generalized, tree.dof_count, coordinates);
    return;
  }
  const Vector6 centre =
      motion_of_centre(free_motion_[index], Eigen::Map<const Vector6>(generalized));
  std::copy_n(centre.data(), 3, coordinates);
  std::copy_n(centre.data() + 3, 3, coordinates + 4);
}

void TreeMotion::to_generalized(int index, const double* coordinates, double* generalized) const {
  const Tree& tree = trees_.tree[index];
  if (tree.free_body)
    Eigen::Map<Vector6>{generalized} =
        motion_of_origin(free_motion_[index], without_zeros(coordinates));
  else
    std::copy_n(coordinates, tree.dof_count, generalized);
}

void TreeMotion::to_generalized_force(int index, const double* coordinates, double* force) const {
  const Tree& tree = trees_.tree[index];
  if (tree.free_body)
    Eigen::Map<Vector6>{force} = generalized_force(free_motion_[index], without_zeros(coordinates));
  else
    std::copy_n(coordinates, tree.dof_count, force);
}

}  // namespace dashpot
