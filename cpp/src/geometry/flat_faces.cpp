#include "dashpot/geometry/flat_faces.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

namespace dashpot {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

// Fractions of the radius of the hull: what vertices of one plane may be away from it, as in files
// with four or five digits; and what a face has to lift on its far side where it ceases to count,
// ten times what contacts are usually pressed in by.
constexpr double kOnePlane = 1e-4, kLift = 0.01;
// Least area, as a fraction of the square of that radius, of the largest polygon of a face: of a
// third of the least face, a triangle that is kLift / tan(kMostTilt) high.
constexpr double kLeastArea = 1e-3;

double cross(const Vector2d& a, const Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

// A vertex in the plane of a face.
struct Corner {
  Vector2d place;
  Vector3d vertex;
};

// How far a corner is from the line through its neighbours, to the left of it.
double inside_of(const Corner& before, const Corner& corner, const Corner& after) {
  const Vector2d side = after.place - before.place;
  return cross(side, corner.place - before.place) / side.norm();
}

// The corners of the convex hull, counterclockwise (Andrew's monotone chain), those left out that
// stand out by less than `straight` from the line through their neighbours.
std::vector<Corner> outline(std::vector<Corner> in, double straight) {
  std::sort(in.begin(), in.end(), [](const Corner& a, const Corner& b) {
    return a.place.x() != b.place.x() ? a.place.x() < b.place.x() : a.place.y() < b.place.y();
  });
  std::vector<Corner> out;
  for (int half = 0; half < 2; ++half) {
    const size_t begin = out.size();
    for (const Corner& next : in) {
      while (out.size() >= begin + 2 && cross(out.back().place - out[out.size() - 2].place,
                                              next.place - out.back().place) <= 0.0)
        out.pop_back();
      out.push_back(next);
    }
    out.pop_back();
    std::reverse(in.begin(), in.end());
  }
  for (size_t i = 0; i < out.size() && out.size() > 3;) {
    const Corner &before = out[(i + out.size() - 1) % out.size()],
                 &after = out[(i + 1) % out.size()];
    if (-inside_of(before, out[i], after) < straight)
      out.erase(out.begin() + i);
    else
      ++i;
  }
  return out;
}

double distance_to_segment(const Vector2d& point, const Vector2d& a, const Vector2d& b) {
  const Vector2d side = b - a;
  const double along = std::clamp((point - a).dot(side) / side.squaredNorm(), 0.0, 1.0);
  return (point - a - along * side).norm();
}

// Distance of a point outside of an outline, 0 inside.
double distance_outside(const Vector2d& point, const std::vector<Corner>& corners) {
  double least = std::numeric_limits<double>::infinity();
  bool inside = true;
  for (size_t i = 0; i < corners.size(); ++i) {
    const Vector2d &a = corners[i].place, &b = corners[(i + 1) % corners.size()].place;
    inside = inside && cross(b - a, point - a) >= 0.0;
    least = std::min(least, distance_to_segment(point, a, b));
  }
  return inside ? 0.0 : least;
}

// The least distance between two parallels that hold an outline.
double width_of(const std::vector<Corner>& corners) {
  double width = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < corners.size(); ++i) {
    const Vector2d& a = corners[i].place;
    const Vector2d side = (corners[(i + 1) % corners.size()].place - a).normalized();
    double height = 0.0;
    for (const Corner& corner : corners) height = std::max(height, cross(side, corner.place - a));
    width = std::min(width, height);
  }
  return width;
}

// The corners that stand for all.
std::vector<Corner> kept_of(const std::vector<Corner>& corners) {
  if (corners.size() <= static_cast<size_t>(kMostCorners)) return corners;
  std::vector<char> kept(corners.size(), 0);
  for (int k = 0; k < kMostCorners; ++k) {
    const double angle = 2.0 * M_PI * k / kMostCorners;
    const Vector2d direction(std::cos(angle), std::sin(angle));
    const auto farthest =
        std::max_element(corners.begin(), corners.end(), [&](const Corner& a, const Corner& b) {
          return direction.dot(a.place) < direction.dot(b.place);
        });
    kept[farthest - corners.begin()] = 1;
  }
  std::vector<Corner> found;
  for (size_t i = 0; i < corners.size(); ++i)
    if (kept[i]) found.push_back(corners[i]);
  return found;
}

}  // namespace

std::vector<FlatFace> flat_faces(const CoarseHull& hull) {
  std::vector<FlatFace> faces;
  const int count = static_cast<int>(hull.facet.size());
  const double radius = hull.radius;
  std::vector<Vector3d> area(count);
  std::vector<double> size(count);
  for (int i = 0; i < count; ++i) {
    area[i] = hull.doubled_area(hull.facet[i]);
    size[i] = area[i].norm();
  }
  std::vector<int> order(count);
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](int a, int b) { return size[a] > size[b]; });
  std::vector<int> seen(hull.corner.cols(), -1);  // the seed of the last face to do with a corner
  std::vector<char> taken(count, 0);
  std::vector<Corner> corners;
  for (int seed : order) {
    if (0.5 * size[seed] < kLeastArea * radius * radius) break;
    if (taken[seed]) continue;
    const std::array<int, 3>& first = hull.facet[seed].corner;
    FlatFace face;
    face.normal = area[seed].normalized();
    face.origin = hull.corner(Eigen::all, first).rowwise().mean();
    const auto depth = [&](int at) { return face.normal.dot(face.origin - hull.corner.col(at)); };
    const auto is_here = [&](int at) { return depth(at) <= kOnePlane * radius; };
    // Its corners, one reached from the other, and those next to them: of a convex body others
    // are not met before these.
    std::vector<int> here(first.begin(), first.end()), beside;
    for (int at : here) seen[at] = seed;
    for (size_t i = 0; i < here.size(); ++i)
      for (int k = hull.around_begin[here[i]]; k < hull.around_begin[here[i] + 1]; ++k) {
        const std::array<int, 3>& around = hull.facet[hull.around[k]].corner;
        if (std::all_of(around.begin(), around.end(), is_here)) taken[hull.around[k]] = 1;
        for (int at : around) {
          if (seen[at] == seed) continue;
          seen[at] = seed;
          (is_here(at) ? here : beside).push_back(at);
        }
      }
    const Vector3d x = (hull.corner.col(first[0]) - face.origin).normalized();
    const Vector3d y = face.normal.cross(x);
    const auto place = [&](int at) {
      const Vector3d arm = hull.corner.col(at) - face.origin;
      return Vector2d(x.dot(arm), y.dot(arm));
    };
    corners.clear();
    for (int at : here) corners.push_back({place(at), hull.corner.col(at)});
    corners = outline(corners, kOnePlane * radius);
    if (corners.size() < 3) continue;
    double tilt = 2.0 * kMostTilt;
    for (int at : beside)
      tilt = std::min(tilt, std::atan2(depth(at), distance_outside(place(at), corners)));
    tilt *= 0.5;
    if (width_of(corners) * std::tan(tilt) < kLift * radius) continue;
    face.cosine = std::cos(tilt);
    for (const Corner& corner : kept_of(corners)) face.corner.push_back(corner.vertex);
    faces.push_back(std::move(face));
  }
  return faces;
}

const FlatFace* face_along(const std::vector<FlatFace>& faces, const Vector3d& direction) {
  const FlatFace* nearest = nullptr;
  double greatest = -1.0;
  for (const FlatFace& face : faces) {
    const double cosine = face.normal.dot(direction);
    if (cosine <= greatest) continue;
    greatest = cosine;
    nearest = &face;
  }
  return nearest;
}

}  // namespace dashpot
