// The surface of a height field: its triangles, and where it bends.

#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <optional>

#include "dashpot/geometry/height_field_grid.hpp"

namespace dashpot {

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
  // Sine of the angle by which the surface rises across an edge, negative where the edge stands
  // out. At the rim -1.
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

}  // namespace dashpot
