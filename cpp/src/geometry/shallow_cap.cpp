#include "dashpot/geometry/shallow_cap.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

namespace dashpot {

using Eigen::Vector3d;

namespace {

// Fraction of the width of a cap between points that are one.
constexpr double kSamePlace = 1e-7;

// Whether a point lies to the left of all sides of a face, seen from outside.
bool is_over(const PlacedFace& face, const Vector3d& point) {
  for (int side = 0; side < face.count; ++side) {
    const Vector3d& begin = face.corner[side];
    const Vector3d& end = face.corner[(side + 1) % face.count];
    if ((end - begin).cross(point - begin).dot(face.normal) < 0.0) return false;
  }
  return true;
}

// Corners of a hull that are put in order by distance: a cap of a few of its sides has more of them
// than kMostPoints, and it is little work for the finest of meshes.
constexpr int kMostSpread = 256;

// By vertex, its place in an order in which each is as far as can be from all before it; beyond the
// first kMostSpread the order is that of the vertices.
std::vector<int> spread_out(const Eigen::Matrix3Xd& vertices) {
  const int count = static_cast<int>(vertices.cols()), last = std::min(count, kMostSpread);
  std::vector<int> place(count);
  std::iota(place.begin(), place.end(), kMostSpread);
  Eigen::RowVectorXd square =
      Eigen::RowVectorXd::Constant(count, std::numeric_limits<double>::infinity());
  for (int next = 0, i = 0; next < last; ++next) {
    place[i] = next;
    square = square.cwiseMin((vertices.colwise() - vertices.col(i)).colwise().squaredNorm());
    square[i] = -1.0;
    square.maxCoeff(&i);
  }
  return place;
}

// The place of one of `count` points along a line in an order in which those before any lie evenly:
// the ends, the middle, the middles of both halves.
int spread_place(int index, int count) {
  int low = 0, high = count - 1;
  if (index == low || index == high) return 0;
  int place = 1;
  for (int middle = (low + high) / 2; middle != index; middle = (low + high) / 2) {
    place = 2 * place + (index > middle);
    (index < middle ? high : low) = middle;
  }
  return place;
}

}  // namespace

HullSurface hull_surface(const Eigen::Matrix3Xd& vertices,
                         const std::vector<std::vector<int>>& polygons) {
  HullSurface hull;
  std::vector<int> corner_of(vertices.cols(), -1);
  for (const std::vector<int>& polygon : polygons)
    for (int vertex : polygon) corner_of[vertex] = 0;
  int count = 0;
  for (int& corner : corner_of)
    if (corner == 0) corner = count++;
  hull.corner.resize(3, count);
  for (int vertex = 0; vertex < vertices.cols(); ++vertex)
    if (corner_of[vertex] >= 0) hull.corner.col(corner_of[vertex]) = vertices.col(vertex);
  hull.place = spread_out(hull.corner);
  for (const std::vector<int>& polygon : polygons) {
    HullFacet facet;
    for (int vertex : polygon) facet.corner.push_back(corner_of[vertex]);
    const auto corner = [&](size_t i) { return hull.corner.col(facet.corner[i]); };
    Vector3d area = Vector3d::Zero();
    for (size_t i = 2; i < facet.corner.size(); ++i)
      area += (corner(i - 1) - corner(0)).cross(corner(i) - corner(0));
    if (area.norm() == 0.0) continue;
    facet.normal = area.normalized();
    facet.offset = -std::numeric_limits<double>::infinity();
    for (size_t i = 0; i < facet.corner.size(); ++i)
      facet.offset = std::max(facet.offset, facet.normal.dot(corner(i)));
    hull.facet.push_back(std::move(facet));
  }
  std::sort(hull.facet.begin(), hull.facet.end(),
            [](const HullFacet& a, const HullFacet& b) { return a.normal.z() < b.normal.z(); });
  return hull;
}

bool ShallowCap::find(const HullSurface& hull, const Pose& pose, const Vector3d& up,
                      double least_width) {
  const Vector3d local_up = pose.rotation.transpose() * up;
  int axis = 0;
  local_up.cwiseAbs().minCoeff(&axis);
  const Vector3d x = (Vector3d::Unit(axis) - local_up[axis] * local_up).normalized();
  const Vector3d y = x.cross(local_up);  // counterclockwise seen from outside
  std::array<double, kMostCorners> cosine, sine;
  std::array<Vector3d, kMostCorners> farthest;
  std::array<double, kMostCorners> reach;
  reach.fill(-std::numeric_limits<double>::infinity());
  for (int k = 0; k < kMostCorners; ++k) {
    const double angle = 2.0 * EIGEN_PI * k / kMostCorners;
    cosine[k] = std::cos(angle);
    sine[k] = std::sin(angle);
  }
  const double shallow = std::cos(kShallow), steep = std::cos(kSteep);
  plane_.clear();
  corner_.clear();
  is_corner_.assign(hull.corner.cols(), 0);
  double lowest = std::numeric_limits<double>::infinity();
  // Unit vectors that are kSteep apart differ by less than that in each coordinate.
  const auto first =
      std::lower_bound(hull.facet.begin(), hull.facet.end(), -local_up.z() - kSteep,
                       [](const HullFacet& facet, double z) { return facet.normal.z() < z; });
  for (auto it = first; it != hull.facet.end() && it->normal.z() <= -local_up.z() + kSteep; ++it) {
    const HullFacet& facet = *it;
    const double slope = facet.normal.dot(local_up);
    if (slope > -steep) continue;
    const Vector3d normal = pose.rotation * facet.normal;
    plane_.push_back({normal, facet.offset + normal.dot(pose.position), slope});
    if (slope > -shallow) continue;
    for (int index : facet.corner) {
      if (is_corner_[index]) continue;
      is_corner_[index] = 1;
      const Vector3d corner = hull.corner.col(index);
      corner_.push_back({pose.position + pose.rotation * corner, hull.place[index]});
      if (const double height = corner.dot(local_up); height < lowest) {
        lowest = height;
        outline_.origin = corner_.back().position;
      }
      const double along_x = corner.dot(x), along_y = corner.dot(y);
      for (int k = 0; k < kMostCorners; ++k) {
        const double along = cosine[k] * along_x + sine[k] * along_y;
        if (along <= reach[k]) continue;
        reach[k] = along;
        farthest[k] = corner;
      }
    }
  }
  if (corner_.empty()) return false;
  width_ = std::numeric_limits<double>::infinity();
  for (int k = 0; k < kMostCorners / 2; ++k)
    width_ = std::min(width_, reach[k] + reach[k + kMostCorners / 2]);
  if (width_ < least_width) return false;
  outline_.normal = -up;
  outline_.count = 0;
  for (int k = 0; k < kMostCorners; ++k)
    if (farthest[k] != farthest[(k + kMostCorners - 1) % kMostCorners])
      outline_.corner[outline_.count++] = pose.position + pose.rotation * farthest[k];
  return outline_.count > 2;
}

double ShallowCap::height_over(const Vector3d& point) const {
  double height = -std::numeric_limits<double>::infinity();
  for (const Plane& plane : plane_) height = std::max(height, plane.height_over(point));
  return height;
}

// From one end to the other the highest plane gives way to the first that meets it, which rises
// more.
const std::vector<Vector3d>& ShallowCap::cross_ridges(const Vector3d& begin, const Vector3d& end,
                                                      double margin) {
  crossing_.clear();
  double first = 0.0, last = 1.0;
  for (int side = 0; side < outline_.count; ++side) {
    const Vector3d& corner = outline_.corner[side];
    const Vector3d inward =
        outline_.normal.cross(outline_.corner[(side + 1) % outline_.count] - corner);
    const double at_begin = inward.dot(begin - corner), at_end = inward.dot(end - corner);
    if (at_begin < 0.0 && at_end < 0.0) return crossing_;
    if (at_begin < 0.0) first = std::max(first, at_begin / (at_begin - at_end));
    if (at_end < 0.0) last = std::min(last, at_begin / (at_begin - at_end));
  }
  line_.clear();
  Line highest;
  for (const Plane& plane : plane_) {
    const double height = plane.height_over(begin);
    const Line line{height, plane.height_over(end) - height};
    // The surface lies below no plane.
    if (std::min(line.at(first), line.at(last)) > margin) return crossing_;
    line_.push_back(line);
    if (line.at(first) > highest.at(first)) highest = line;
  }
  while (first < last) {
    const Line* next = nullptr;
    double soonest = last;
    for (const Line& line : line_) {
      if (line.rise <= highest.rise) continue;
      const double meets = (highest.height - line.height) / (line.rise - highest.rise);
      if (meets >= soonest) continue;
      soonest = meets;
      next = &line;
    }
    if (!next) break;
    highest = *next;
    first = soonest;
    if (highest.at(first) <= margin) crossing_.push_back(begin + first * (end - begin));
  }
  return crossing_;
}

bool ShallowCap::Point::comes_before(const Point& other) const {
  const bool touches = at.distance < 0.0, other_touches = other.at.distance < 0.0;
  if (touches != other_touches) return touches;
  return touches ? place < other.place : at.distance < other.at.distance;
}

bool ShallowCap::has_point_over(const Vector3d& place) const {
  return std::any_of(point_.begin(), point_.end(), [&](const Point& other) {
    return outline_.normal.cross(other.at.position - place).norm() <= kSamePlace * width_;
  });
}

void ShallowCap::take_points(FaceManifold& manifold) {
  if (point_.size() > kMostPoints) {
    std::nth_element(point_.begin(), point_.begin() + kMostPoints, point_.end(),
                     [](const Point& a, const Point& b) { return a.comes_before(b); });
    point_.resize(kMostPoints);
  }
  for (const Point& point : point_) manifold.point[manifold.count++] = point.at;
}

FaceManifold ShallowCap::meet_plane(const Vector3d& origin, double margin) {
  FaceManifold manifold;
  manifold.normal = -outline_.normal;
  const Vector3d& up = manifold.normal;
  point_.clear();
  for (const Corner& corner : corner_) {
    const double distance = up.dot(corner.position - origin);
    if (distance <= margin)
      point_.push_back({{corner.position - 0.5 * distance * up, distance}, corner.place});
  }
  take_points(manifold);
  return manifold;
}

FaceManifold ShallowCap::meet_face(const PlacedFace& face, double margin, const Vector3d& nearest,
                                   double tolerance) {
  const Vector3d& up = face.normal;
  const FaceManifold outline =
      dashpot::meet_face(face, outline_, std::numeric_limits<double>::infinity());
  FaceManifold manifold;
  manifold.normal = outline.normal;
  const auto on_face = [&](const Vector3d& point) -> Vector3d {
    return point - up.dot(point - face.origin) * up;
  };
  // The point over one of the face, midway between that and what lies above or below it.
  const auto point_over = [&](const Vector3d& place) {
    const double distance = height_over(place);
    return FacePoint{place + 0.5 * distance * up, distance};
  };
  const auto add_over = [&](const Vector3d& over, int place) {
    if (has_point_over(over)) return;
    const FacePoint point = point_over(over);
    if (point.distance <= margin) point_.push_back({point, place});
  };
  point_.clear();
  for (const Corner& corner : corner_) {
    const double distance = up.dot(corner.position - face.origin);
    if (distance <= margin && is_over(face, corner.position))
      point_.push_back({{corner.position - 0.5 * distance * up, distance}, corner.place});
  }
  for (int i = 0; i < outline.count; ++i) add_over(on_face(outline.point[i].position), kFirst);
  for (int side = 0; side < face.count; ++side) {
    const std::vector<Vector3d>& crossing =
        cross_ridges(face.corner[side], face.corner[(side + 1) % face.count], margin);
    const int count = static_cast<int>(crossing.size());
    for (int i = 0; i < count; ++i) add_over(crossing[i], spread_place(i, count));
  }
  const FacePoint found = point_over(on_face(nearest));
  if (std::all_of(
          point_.begin(), point_.end(),
          [&](const Point& point) { return found.distance < point.at.distance - tolerance; }) &&
      found.distance <= margin && !has_point_over(found.position))
    point_.push_back({found, kFirst});
  take_points(manifold);
  return manifold;
}

}  // namespace dashpot
