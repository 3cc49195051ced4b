// The triangular prisms of a height field.

#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <memory>
#include <vector>

#include "dashpot/geometry/terrain.hpp"

namespace dashpot {

// One prism in the field's frame: from z = -base up to the triangle `top`.
struct Prism {
  std::array<Eigen::Vector3d, 3> top;
  double base = 0.0;

  Eigen::AlignedBox3d box() const;
  // How far (m) it reaches along `direction`.
  double reach(const Eigen::Vector3d& direction) const;
};

// A rectangle of cells, bounds included.
struct CellRange {
  int first_row = 0, last_row = 0, first_column = 0, last_column = 0;
};

class Prisms {
 public:
  explicit Prisms(const HeightField& field);

  CellRange all() const { return {0, grid_.rows() - 1, 0, grid_.columns() - 1}; }
  // The cells that meet a box, looking down z; the nearest ones where it is beyond the rim.
  CellRange cells(const Eigen::AlignedBox3d& box) const;
  // A range in blocks of at most 16 x 16 cells.
  static std::vector<CellRange> blocks(const CellRange& range);
  // Bounding box of the prisms of a range. Heights that are not finite are left out.
  Eigen::AlignedBox3d box(const CellRange& range) const;

  // Index of a prism of the cell that holds a point or, beyond the rim, is nearest to it.
  int beneath(const Eigen::Vector3d& point) const;
  // Throws std::invalid_argument naming a height that is not finite.
  Prism at(int index) const {
    return at(index / 2 / grid_.columns(), index / 2 % grid_.columns(), index % 2);
  }
  // Calls visit(index, prism) for every prism of a range. Throws as at().
  template <typename Visit>
  void visit(const CellRange& range, const Visit& visit) const {
    for (int row = range.first_row; row <= range.last_row; ++row) {
      for (int column = range.first_column; column <= range.last_column; ++column) {
        const int index = 2 * (row * grid_.columns() + column);
        visit(index, at(row, column, 0));
        visit(index + 1, at(row, column, 1));
      }
    }
  }

  // Length (m) of the longer side of a cell.
  double cell_size() const { return std::max(grid_.width(), grid_.depth()); }

 private:
  Prism at(int row, int column, int half) const;
  Eigen::Vector3d finite_corner(int row, int column) const;

  const HeightField& field_;
  HeightFieldGrid grid_;
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
  std::shared_ptr<Hull> hull_;
  Shape shape_;
  Pose pose_;
};

}  // namespace dashpot
