// The surface of a height field: its triangles, and where it bends.

#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <optional>

#include "dashpot/geometry/shape.hpp"

namespace dashpot {

// Where the corners and cells of a height field are, in its frame.
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

// Sine of the angle by which a surface bends at an edge up to which it is flat there: what rounding
// of heights to single precision leaves, some 1e-7 of the height over a cell, and more.
inline constexpr double kFlatBend = 1e-5;

// In the frame of the field. Edge i leads from corner i to the next one.
struct TerrainTriangle {
  int row = 0, column = 0, half = 0;  // of its cell; half 1 lies above the diagonal, along y
  std::array<Eigen::Vector3d, 3> corner;
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  // unit, upward

  bool is_same(const TerrainTriangle& other) const {
    return row == other.row && column == other.column && half == other.half;
  }
  double height_of(const Eigen::Vector3d& point) const { return normal.dot(point - corner[0]); }
  // Distance (m) of a point from the line along an edge.
  double distance_to(int edge, const Eigen::Vector3d& point) const;
};

class Terrain {
 public:
  explicit Terrain(const HeightField& field);

  // The one triangle above or below a point, looking down z; none beyond the rim.
  std::optional<TerrainTriangle> beneath(const Eigen::Vector3d& point) const;
  // Its normal; z beyond the rim.
  Eigen::Vector3d normal_beneath(const Eigen::Vector3d& point) const;
  // Visits all others of its cell and of the cells about that.
  template <typename Visit>
  void for_each_about(const TerrainTriangle& triangle, const Visit& visit) const {
    const int last_row = std::min(triangle.row + 1, grid_.rows() - 1),
              last_column = std::min(triangle.column + 1, grid_.columns() - 1);
    for (int row = std::max(triangle.row - 1, 0); row <= last_row; ++row)
      for (int column = std::max(triangle.column - 1, 0); column <= last_column; ++column)
        for (int half : {0, 1})
          if (const TerrainTriangle other = at(row, column, half); !other.is_same(triangle))
            visit(other);
  }
  // The triangle across an edge; none at the rim.
  std::optional<TerrainTriangle> across(const TerrainTriangle& triangle, int edge) const;
  // Sine of the angle by which the surface rises across an edge, < 0 where it stands out; rim: -1.
  double bend(const TerrainTriangle& triangle, int edge) const;
  // Whether the surface is flat at all edges whose lines pass within `near` (m) of a point on a
  // triangle. False where these are of more triangles than meet at a vertex.
  bool is_flat_about(const TerrainTriangle& triangle, const Eigen::Vector3d& point,
                     double near) const;
  // Whether a unit direction leads out of the surface at a point on a triangle, as the normal of a
  // contact there does: of the triangles with edges that pass within `near` (m) of the point none
  // rises along it. In grooves no direction does.
  bool leads_out(const TerrainTriangle& triangle, const Eigen::Vector3d& point,
                 const Eigen::Vector3d& direction, double near) const;
  // The highest point (m) of all cells within `radius` (m) of a point, looking down z.
  double highest_about(const Eigen::Vector3d& point, double radius) const;

 private:
  static constexpr int kAroundVertex = 6;
  // Triangles, the first of them given, that meet at edges whose lines pass near a point.
  struct Fan {
    std::array<TerrainTriangle, kAroundVertex> triangle;
    int count = 0;
    bool is_flat = true;  // at all these edges
  };
  Fan about(const TerrainTriangle& triangle, const Eigen::Vector3d& point, double near) const;
  TerrainTriangle at(int row, int column, int half) const;

  const HeightField& field_;
  HeightFieldGrid grid_;
};

// Fraction of the geom's radius by which a contact may be less deep than one that it stands for.
inline constexpr double kAsDeep = 1e-5;

struct TerrainContact {
  Eigen::Vector3d position, normal;  // halfway between the surfaces, m; unit, out of the terrain
  double distance = 0.0;             // m, negative in overlap
  int surface = -1;                  // of the geom's round ones that touches; -1 where none does
};

// Whether contacts of a round surface with two planes, found where their lowest points lie over
// triangles of them, are one: `deepest` (m) the smaller of their distances, `apart` (m) how far
// apart they are, `turn` the distance of their normals, `approach` (m) that of the step along it.
//
// Under the radius r planes that differ by the angle a are touched a r apart, each from where the
// other is a^2 r / 2 deep on. A surface that lies deeper has touched the second before it is found,
// and then two springs would bear what one does. What is rigid meets the second within a step of
// coming to lie over it, and hits it.
bool are_in_one_place(double deepest, double apart, double turn, double approach);

// The contacts of one geom with a terrain, in the frame of that.
class TerrainContacts {
 public:
  static constexpr int kRoom = 50;

  // `radius` (m) of the geom about its centre.
  explicit TerrainContacts(double radius) : radius_(radius) {}

  int count() const { return count_; }
  const TerrainContact* begin() const { return contact_.data(); }
  const TerrainContact* end() const { return contact_.data() + count_; }

  // The nearest stay where there is no room for all.
  void add(const TerrainContact& contact);
  // Whether one that is as deep stands for one within `place` (m), of normals within `cosine`.
  bool has(const Eigen::Vector3d& position, const Eigen::Vector3d& normal, double distance,
           double place, double cosine) const;
  // Whether one of a round surface is on the plane of a triangle about a point of the geom.
  bool has_on_plane(const TerrainTriangle& triangle, const Eigen::Vector3d& point,
                    int surface) const;
  double deepest() const;  // least distance (m), 0 where nothing overlaps
  // Of those of a round surface in one place the deepest stays; `way` (m) of the geom in the step.
  void merge(const Eigen::Vector3d& way);

 private:
  double radius_;
  std::array<TerrainContact, kRoom> contact_;
  int count_ = 0;
};

}  // namespace dashpot
