#include "prisms.hpp"

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace dashpot {

using Eigen::AlignedBox3d;
using Eigen::Vector3d;

AlignedBox3d Prism::box() const {
  AlignedBox3d box(top[0]);
  box.extend(top[1]);
  box.extend(top[2]);
  box.min().z() = -base;
  return box;
}

double Prism::reach(const Vector3d& direction) const {
  double furthest = -std::numeric_limits<double>::infinity();
  for (const Vector3d& corner : top) {
    const double z = direction.z() < 0.0 ? -base : corner.z();
    furthest = std::max(furthest, direction.dot(Vector3d(corner.x(), corner.y(), z)));
  }
  return furthest;
}

namespace {

constexpr int kBlock = 16;  // cells a side

}  // namespace

Prisms::Prisms(const HeightField& field) : field_(field), grid_(field) {}

Vector3d Prisms::finite_corner(int row, int column) const {
  const double height = field_.heights[row * field_.columns + column];
  if (!std::isfinite(height)) {
    throw std::invalid_argument(field_.label + ": the height of row " + std::to_string(row) +
                                ", column " + std::to_string(column) + " is " +
                                std::to_string(height));
  }
  return grid_.corner(row, column);
}

Prism Prisms::at(int row, int column, int half) const {
  Prism prism;
  prism.base = field_.base;
  const auto corners = HeightFieldGrid::corners(row, column, half);
  for (int i = 0; i < 3; ++i) prism.top[i] = finite_corner(corners[i][0], corners[i][1]);
  return prism;
}

CellRange Prisms::cells(const AlignedBox3d& box) const {
  const auto cell = [](double line, int count) {
    return static_cast<int>(std::clamp(std::floor(line), 0.0, count - 1.0));
  };
  return {cell(grid_.row_at(box.min().y()), grid_.rows()),
          cell(grid_.row_at(box.max().y()), grid_.rows()),
          cell(grid_.column_at(box.min().x()), grid_.columns()),
          cell(grid_.column_at(box.max().x()), grid_.columns())};
}

std::vector<CellRange> Prisms::blocks(const CellRange& range) {
  std::vector<CellRange> blocks;
  for (int row = range.first_row; row <= range.last_row; row += kBlock) {
    for (int column = range.first_column; column <= range.last_column; column += kBlock) {
      blocks.push_back({row, std::min(row + kBlock - 1, range.last_row), column,
                        std::min(column + kBlock - 1, range.last_column)});
    }
  }
  return blocks;
}

AlignedBox3d Prisms::box(const CellRange& range) const {
  // Rows are compared lane by lane, which compilers turn into vector instructions.
  constexpr int kColumnsAtOnce = 8;
  float highest[kColumnsAtOnce];
  std::fill_n(highest, kColumnsAtOnce, -std::numeric_limits<float>::infinity());
  const int count = range.last_column - range.first_column + 2;
  for (int row = range.first_row; row <= range.last_row + 1; ++row) {
    const float* heights = field_.heights + row * field_.columns + range.first_column;
    int i = 0;
    for (; i + kColumnsAtOnce <= count; i += kColumnsAtOnce)
      for (int lane = 0; lane < kColumnsAtOnce; ++lane)
        highest[lane] = heights[i + lane] > highest[lane] ? heights[i + lane] : highest[lane];
    for (; i < count; ++i) highest[0] = heights[i] > highest[0] ? heights[i] : highest[0];
  }
  const double top = *std::max_element(highest, highest + kColumnsAtOnce);
  return {Vector3d(grid_.x(range.first_column), grid_.y(range.first_row), -field_.base),
          Vector3d(grid_.x(range.last_column + 1), grid_.y(range.last_row + 1),
                   field_.elevation * top)};
}

int Prisms::beneath(const Vector3d& point) const {
  const CellRange cell = cells(AlignedBox3d(point));
  return 2 * (cell.first_row * grid_.columns() + cell.first_column);
}

PlacedPrism::PlacedPrism(const Pose& field) : field_(field), hull_(std::make_shared<Hull>()) {
  shape_.type = ShapeType::kHull;
  shape_.hull = hull_;
  pose_.rotation = field.rotation;
}

void PlacedPrism::set(const Prism& prism) {
  // About its own middle: far from the field's, coordinates would lose digits.
  const Vector3d middle = prism.box().center();
  Eigen::Matrix<double, 3, 6> corners;
  for (int i = 0; i < 3; ++i) {
    corners.col(i) = prism.top[i] - middle;
    corners.col(i + 3) = corners.col(i);
    corners(2, i + 3) = -prism.base - middle.z();
  }
  hull_->set(corners);
  pose_.position = field_.position + field_.rotation * middle;
}

}  // namespace dashpot
