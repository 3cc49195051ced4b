// Where the corners and cells of a height field are, in its frame.

#pragma once

#include <Eigen/Core>
#include <array>

#include "dashpot/geometry/shape.hpp"

namespace dashpot {

class HeightFieldGrid {
 public:
  // The field must outlive it.
  explicit HeightFieldGrid(const HeightField& field)
      : field_(field),
        width_(2.0 * field.half_x / (field.columns - 1)),
        depth_(2.0 * field.half_y / (field.rows - 1)) {}

  int rows() const { return field_.rows - 1; }        // of cells
  int columns() const { return field_.columns - 1; }  // of cells
  double width() const { return width_; }             // m, of a cell along x
  double depth() const { return depth_; }             // m, of a cell along y

  // Lines of the grid, m; and on which line, or between which, a place is.
  double x(int column) const { return column * width_ - field_.half_x; }
  double y(int row) const { return row * depth_ - field_.half_y; }
  double column_at(double x) const { return (x + field_.half_x) / width_; }
  double row_at(double y) const { return (y + field_.half_y) / depth_; }

  // As high as the field has it, finite or not.
  Eigen::Vector3d corner(int row, int column) const {
    return {x(column), y(row), field_.elevation * field_.heights[row * field_.columns + column]};
  }
  // Row and column of the corners of one of the two triangles of a cell: its low and its high
  // corner, and the third, of `half` 0 along x, of 1 along y.
  static std::array<std::array<int, 2>, 3> corners(int row, int column, int half) {
    return {{{row, column}, {row + 1, column + 1}, {row + half, column + 1 - half}}};
  }

 private:
  const HeightField& field_;
  double width_, depth_;
};

}  // namespace dashpot
