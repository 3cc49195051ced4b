// The triangular prisms of a height field.

#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <memory>

#include "dashpot/shape.hpp"

namespace dashpot {

// One prism in the field's frame: from z = -base up to the triangle `top`.
struct Prism {
  std::array<Eigen::Vector3d, 3> top;
  double base = 0.0;

  Eigen::AlignedBox3d box() const;
  // Furthest extent (m) along `direction`.
  double reach(const Eigen::Vector3d& direction) const;
};

class Prisms {
 public:
  explicit Prisms(const HeightField& field);

  int count() const { return 2 * (field_.rows - 1) * (field_.columns - 1); }
  // `index` in [0, count). Throws std::invalid_argument naming a height that is not finite.
  Prism at(int index) const;
  // Index of a prism of the cell that holds a point or, beyond the rim, is nearest to it.
  int beneath(const Eigen::Vector3d& point) const;
  // Calls `visit` with the indices of the prisms whose cells meet the box, looking down z, or are
  // nearest to where it is beyond the rim.
  template <typename Visit>
  void visit(const Eigen::AlignedBox3d& box, const Visit& visit) const {
    const int first_column = column(box.min().x()), last_column = column(box.max().x());
    const int first_row = row(box.min().y()), last_row = row(box.max().y());
    for (int r = first_row; r <= last_row; ++r) {
      for (int c = first_column; c <= last_column; ++c) {
        const int cell = r * (field_.columns - 1) + c;
        visit(2 * cell);
        visit(2 * cell + 1);
      }
    }
  }
  // Length (m) of the longer side of a cell.
  double cell_size() const { return std::max(width_, depth_); }

 private:
  int column(double x) const;
  int row(double y) const;
  Eigen::Vector3d corner(int row, int column) const;

  const HeightField& field_;
  double width_ = 0.0, depth_ = 0.0;  // m, of a cell along x and y
};

// A prism as a convex hull, placed in the world. One object serves many prisms in turn.
class PlacedPrism {
 public:
  explicit PlacedPrism(const Pose& field);
  void set(const Prism& prism);
  const Shape& shape() const { return shape_; }
  const Pose& pose() const { return pose_; }

 private:
  Pose field_;
  std::shared_ptr<Eigen::Matrix3Xd> corners_;
  Shape shape_;
  Pose pose_;
};

}  // namespace dashpot
