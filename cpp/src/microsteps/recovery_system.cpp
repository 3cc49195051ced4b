#include "dashpot/microsteps/recovery_system.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>

#include "dashpot/islands/islands.hpp"

namespace dashpot {

namespace {

constexpr double kSoftness = 0.01;  // of an equality's inverse mass, at least
// Of more coordinates, the factors of what loops of free bodies couple take longer than iterations.
constexpr int kFewCoordinates = 128;
constexpr int kMaxIterations = 20;  // of conjugate gradients
// Of the squared residual, relative: a millionth of what recovers is left for the next step.
constexpr double kConverged = 1e-12;

// Calls `function` with every motion coordinate of a tree that moves.
template <typename Function>
void for_each_coordinate(const Tree& t, const Function& function) {
  for (int i = 0; i < t.dof_count; ++i) function(t.begin + (t.free_body && i >= 3 ? i + 1 : i));
}

}  // namespace

void RecoverySystem::reset(const Rows& rows, const Trees& trees, const Island& island, double reach,
                           double time, const RowData& data) {
  rows_ = &rows;
  trees_ = &trees;
  island_ = &island;
  group_.clear();
  target_.clear();
  softness_.clear();
  scale_.clear();
  for (int index : island.group) {
    const RowGroup& c = rows.group[index];
    const double x = data.deformation[c.row];
    const bool bilateral = c.kind == RowKind::kBilateral;
    if (!bilateral && c.kind != RowKind::kSlider && x >= 0.0) continue;
    group_.push_back(index);
    const bool sticks = data.sticking[index];
    for (int row = c.row; row < c.row + c.dim; ++row) {
      const bool slips = !sticks && (row > c.row || c.kind == RowKind::kSlider);
      const double k = rows.stiffness[row];
      const double w = rows.inverse_mass[row];
      const double softness = bilateral
                                  ? std::max(kSoftness * w, rows.typical_inverse_mass[row] - w)
                                  : 1.0 / (k * time * time);
      const bool acts = !slips && k > 0.0 && w + softness > 0.0;
      softness_.push_back(acts ? softness : 0.0);
      scale_.push_back(acts ? 1.0 / (w + softness) : 0.0);
      target_.push_back(0.0);
    }
    // Where the spring is deformed beyond the position there is nothing to recover.
    const double offset = data.offset[index];
    if (bilateral && offset * (x - offset) < 0.0)
      target_.back() = std::clamp(offset, -reach, reach);
  }
}

bool RecoverySystem::empty() const {
  return std::all_of(target_.begin(), target_.end(), [](double t) { return t == 0.0; });
}

void RecoverySystem::solve(std::vector<double>& displacement) {
  multiplier_.assign(target_.size(), 0.0);
  number_coordinates();
  if (size_ <= kFewCoordinates)
    factorize_and_solve(displacement);
  else
    iterate(displacement);
}

// d' H d = d' J' e.
double RecoverySystem::square() const {
  double sum = 0.0;
  for (size_t i = 0; i < shift_.size(); ++i) sum += shift_[i] * multiplier_[i];
  return sum;
}

void RecoverySystem::number_coordinates() {
  number_.resize(trees_->coordinates);
  size_ = 0;
  for (int index : island_->tree)
    for_each_coordinate(trees_->tree[index], [&](int i) { number_[i] = size_++; });
}

void RecoverySystem::add_inertia(const Tree& t) {
  const int first = number_[t.begin];
  double* diagonal = matrix_.data() + first * (size_ + 1);
  if (t.free_body) {
    const double* inverse = trees_->inverse.data() + t.inverse;
    for (int i = 0; i < 3; ++i) diagonal[i * (size_ + 1)] = 1.0 / inverse[i];
    const Eigen::Map<const Eigen::Matrix3d, 0, Eigen::OuterStride<4>> rotational(inverse + 4);
    const Eigen::Matrix3d inertia = rotational.inverse();
    for (int j = 0; j < 3; ++j)
      for (int i = j; i < 3; ++i) diagonal[(3 + j) * size_ + 3 + i] = inertia(i, j);
    return;
  }
  // L' D L: of each row of L what it couples, itself and those above it.
  const int n = t.dof_count;
  const double* factor = trees_->factor.data() + t.inverse;
  const int* above = trees_->above.data() + t.dof_begin;
  const auto next = [&](int i) { return above[i] < 0 ? -1 : above[i] - t.dof_begin; };
  for (int k = 0; k < n; ++k) {
    const double* row = factor + trees_->row_begin[t.dof_begin + k];
    const auto entry = [&](int i) { return i == k ? 1.0 : row[i]; };
    for (int i = k; i >= 0; i = next(i))
      for (int j = i; j >= 0; j = next(j)) diagonal[j * size_ + i] += row[k] * entry(i) * entry(j);
  }
}

// Adds J' inv(R) J and J' inv(R) t.
void RecoverySystem::add_rows() {
  size_t row = 0;
  for (int index : group_) {
    const RowGroup& c = rows_->group[index];
    for (int i = 0; i < c.dim; ++i, ++row) {
      if (scale_[row] == 0.0) continue;
      find_columns(c, i);
      for (size_t a = 0; a < column_.size(); ++a) {
        const double weighted = entry_[a] / softness_[row];
        solution_[column_[a]] += weighted * target_[row];
        for (size_t b = 0; b <= a; ++b) {
          const auto [left, below] = std::minmax(column_[a], column_[b]);
          matrix_[left * size_ + below] += weighted * entry_[b];
        }
      }
    }
  }
}

// Row i of a group over the coordinates that move.
void RecoverySystem::find_columns(const RowGroup& c, int i) {
  column_.clear();
  entry_.clear();
  const auto append = [&](int coordinate, double value) {
    column_.push_back(number_[coordinate]);
    entry_.push_back(value);
  };
  if (c.pair < 0) {
    for (int k = 0; k < c.columns[0] + c.columns[1]; ++k)
      append(rows_->column[c.column + k], rows_->value[c.value + i * c.width() + k]);
    return;
  }
  double unit[kMaxRows] = {};
  unit[i] = 1.0;
  clear(impulse_);
  scatter(*rows_, c, unit, impulse_.data());
  for (int tree : c.tree)
    if (tree >= 0) for_each_coordinate(trees_->tree[tree], [&](int k) { append(k, impulse_[k]); });
}

void RecoverySystem::factorize_and_solve(std::vector<double>& displacement) {
  matrix_.assign(size_ * size_, 0.0);
  solution_.assign(size_, 0.0);
  for (int index : island_->tree) add_inertia(trees_->tree[index]);
  add_rows();
  Eigen::Map<Eigen::MatrixXd> matrix(matrix_.data(), size_, size_);
  Eigen::Map<Eigen::VectorXd> solution(solution_.data(), size_);
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> factors(matrix);
  if (factors.info() == Eigen::Success)
    factors.solveInPlace(solution);
  else  // where rounding leaves nothing of light bodies beside stiff springs, they wait
    solution.setZero();
  for (int index : island_->tree)
    for_each_coordinate(trees_->tree[index],
                        [&](int i) { displacement[i] = solution_[number_[i]]; });
  project(displacement, shift_);
  for (size_t i = 0; i < shift_.size(); ++i)
    if (scale_[i] > 0.0) multiplier_[i] = (target_[i] - shift_[i]) / softness_[i];
}

void RecoverySystem::iterate(std::vector<double>& displacement) {
  const size_t n = target_.size();
  residual_ = target_;
  direction_.resize(n);
  double square = 0.0;
  for (size_t i = 0; i < n; ++i) {
    direction_[i] = scale_[i] * residual_[i];
    square += residual_[i] * direction_[i];
  }
  const double small = kConverged * square;
  for (int iteration = 0; iteration < kMaxIterations && square > small; ++iteration) {
    displace(direction_, displacement);
    project(displacement, image_);
    double curvature = 0.0;
    for (size_t i = 0; i < n; ++i) {
      image_[i] += softness_[i] * direction_[i];
      curvature += direction_[i] * image_[i];
    }
    if (!(curvature > 0.0)) break;
    const double alpha = square / curvature;
    double next = 0.0;
    for (size_t i = 0; i < n; ++i) {
      multiplier_[i] += alpha * direction_[i];
      residual_[i] -= alpha * image_[i];
      next += scale_[i] * residual_[i] * residual_[i];
    }
    for (size_t i = 0; i < n; ++i)
      direction_[i] = scale_[i] * residual_[i] + next / square * direction_[i];
    square = next;
  }
  displace(multiplier_, displacement);
  project(displacement, shift_);
}

void RecoverySystem::project(const std::vector<double>& displacement,
                             std::vector<double>& out) const {
  out.resize(target_.size());
  double* of_group = out.data();
  for (int index : group_) {
    const RowGroup& c = rows_->group[index];
    gather(*rows_, c, displacement.data(), of_group);
    of_group += c.dim;
  }
}

// displacement = inv(H) J' multiplier.
void RecoverySystem::displace(const std::vector<double>& multiplier,
                              std::vector<double>& displacement) {
  clear(impulse_);
  clear(displacement);
  const double* factor = multiplier.data();
  for (int index : group_) {
    const RowGroup& c = rows_->group[index];
    scatter(*rows_, c, factor, impulse_.data());
    factor += c.dim;
  }
  for (int index : island_->tree) {
    const Tree& t = trees_->tree[index];
    add_response(*trees_, index, impulse_.data() + t.begin, displacement.data() + t.begin);
  }
}

// Zero over the trees of the island.
void RecoverySystem::clear(std::vector<double>& motion) const {
  motion.resize(trees_->coordinates);
  for (int index : island_->tree) {
    const Tree& t = trees_->tree[index];
    std::fill_n(motion.begin() + t.begin, t.count, 0.0);
  }
}

}  // namespace dashpot
