#include "dashpot/prisms.hpp"

#include <algorithm>
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

Prisms::Prisms(const HeightField& field)
    : field_(field),
      width_(2.0 * field.half_x / (field.columns - 1)),
      depth_(2.0 * field.half_y / (field.rows - 1)) {}

Vector3d Prisms::corner(int row, int column) const {
  const double height = field_.heights[row * field_.columns + column];
  if (!std::isfinite(height)) {
    throw std::invalid_argument(field_.label + ": the height of row " + std::to_string(row) +
                                ", column " + std::to_string(column) + " is " +
                                std::to_string(height));
  }
  return {column * width_ - field_.half_x, row * depth_ - field_.half_y, field_.elevation * height};
}

Prism Prisms::at(int index) const {
  const int cell = index / 2;
  const int row = cell / (field_.columns - 1), column = cell % (field_.columns - 1);
  const Vector3d low = corner(row, column), high = corner(row + 1, column + 1);
  Prism prism;
  prism.base = field_.base;
  prism.top = {low, high, index % 2 ? corner(row + 1, column) : corner(row, column + 1)};
  return prism;
}

int Prisms::column(double x) const {
  const double cell = std::floor((x + field_.half_x) / width_);
  return static_cast<int>(std::clamp(cell, 0.0, field_.columns - 2.0));
}

int Prisms::row(double y) const {
  const double cell = std::floor((y + field_.half_y) / depth_);
  return static_cast<int>(std::clamp(cell, 0.0, field_.rows - 2.0));
}

int Prisms::beneath(const Vector3d& point) const {
  return 2 * (row(point.y()) * (field_.columns - 1) + column(point.x()));
}

PlacedPrism::PlacedPrism(const Pose& field)
    : field_(field), corners_(std::make_shared<Eigen::Matrix3Xd>(3, 6)) {
  shape_.type = ShapeType::kHull;
  shape_.vertices = corners_;
  pose_.rotation = field.rotation;
}

void PlacedPrism::set(const Prism& prism) {
  // About its own middle: far from the field's, coordinates would lose digits.
  const Vector3d middle = prism.box().center();
  for (int i = 0; i < 3; ++i) {
    corners_->col(i) = prism.top[i] - middle;
    corners_->col(i + 3) = corners_->col(i);
    (*corners_)(2, i + 3) = -prism.base - middle.z();
  }
  pose_.position = field_.position + field_.rotation * middle;
}

}  // namespace dashpot
