// Penetration depth by the expanding polytope algorithm (van den Bergen 2001).
//
// A polytope of support points grows inside the difference of the two cores. Its face nearest to
// the origin bounds the depth from below, the support point along that face's normal from above;
// the support point joins the polytope until the bounds meet. The polytope need not hold the origin
// at the start: a face that has the origin outside has a negative offset and is the first to grow.

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "dashpot/geometry/convex_distance.hpp"

namespace dashpot {

using Eigen::Vector3d;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Of 60,000 random pairs of decimetres, twice as many rounds change depths by 2e-6 m at most.
constexpr int kMaxRounds = 192;
// Where a whole ring of directions is equally near, rounds go into all of it. A looser tolerance
// then does, for refinement to start from.
constexpr int kPatience = 48;
constexpr double kImpatientTolerance = 1e-5;
constexpr int kMaxFaces = 2 * (kMaxRounds + 4);  // of a closed polytope; more means a torn one
// Of the size of the pair: how near bounds have to come, as in refinement, and what is so thin that
// a ten-thousandth of it is rounding.
constexpr double kTolerance = 1e-10;
constexpr double kFlat = 1e-12;
// Sine of a corner below which a face is a sliver without direction: its edges are rounded to
// 1e-16. None at all or 1e-10 leaves depths as they are.
constexpr double kSliver = 1e-14;
// Weight of a corner up to which a point beyond the opposite edge is on it.
constexpr double kOnEdge = 1e-12;

struct Face {
  std::array<int, 3> vertex{};         // counter-clockwise from outside
  Vector3d normal = Vector3d::Zero();  // unit, outward; zero for a sliver
  double offset = kInfinity;           // normal.x of its plane; a sliver is never the nearest
};

class Polytope {
 public:
  // Tetrahedron of four support points; false where no four of them span a volume.
  bool start(const std::array<DifferencePoint, 4>& corners, double flat) {
    vertices_.assign(corners.begin(), corners.end());
    faces_.clear();
    rim_.clear();
    const Vector3d edge1 = at(1) - at(0), edge2 = at(2) - at(0), edge3 = at(3) - at(0);
    const Vector3d normal = edge1.cross(edge2);
    const double height = normal.norm() > 0.0 ? edge3.dot(normal.normalized()) : 0.0;
    if (std::abs(height) <= flat) return false;
    const bool above = height > 0.0;
    for (const auto& [a, b, c] : {std::array{0, 1, 2}, {0, 3, 1}, {0, 2, 3}, {1, 3, 2}})
      add_face(a, above ? c : b, above ? b : c);
    return true;
  }

  // Index of the face nearest to the origin.
  int nearest() const {
    const auto least =
        std::min_element(faces_.begin(), faces_.end(),
                         [](const auto& a, const auto& b) { return a.offset < b.offset; });
    return static_cast<int>(least - faces_.begin());
  }

  int face_count() const { return static_cast<int>(faces_.size()); }
  const Face& face(int index) const { return faces_[index]; }

  // Takes in a point beyond face `nearest`: the faces that see it give way to a cone from their
  // rim. A face sees the point if that is more than `flat` above its plane.
  void grow(const DifferencePoint& point, int nearest, double flat) {
    const Vector3d& position = point.difference;
    const int apex = static_cast<int>(vertices_.size());
    vertices_.push_back(point);
    rim_.clear();
    std::size_t kept = 0;
    for (std::size_t i = 0; i < faces_.size(); ++i) {
      const Face& face = faces_[i];
      const bool sees =
          static_cast<int>(i) == nearest || face.normal.dot(position) > face.offset + flat;
      if (sees)
        for (int k = 0; k < 3; ++k) add_to_rim(face.vertex[k], face.vertex[(k + 1) % 3]);
      else
        faces_[kept++] = face;
    }
    faces_.resize(kept);
    for (const auto& [from, to] : rim_) add_face(from, to, apex);
  }

  // Gives the point nearest to the origin of a plane, `depth` along `normal`, as points of the two
  // cores. Of the faces in it, to `flat`, that is the one which holds the point; false where none
  // does, as where rounding has made slivers of it.
  bool find_witness(double depth, const Vector3d& normal, double flat, Distance& result) const {
    for (const Face& face : faces_) {
      if (face.offset > depth + flat) continue;
      const Vector3d origin = at(face.vertex[0]);
      const Vector3d edge1 = at(face.vertex[1]) - origin, edge2 = at(face.vertex[2]) - origin;
      const Vector3d across = edge1.cross(edge2);
      const double area = across.squaredNorm();
      const double weight1 = -across.dot(origin.cross(edge2)) / area;
      const double weight2 = -across.dot(edge1.cross(origin)) / area;
      const std::array<double, 3> weight{1.0 - weight1 - weight2, weight1, weight2};
      if (*std::min_element(weight.begin(), weight.end()) < -kOnEdge) continue;
      result.point1.setZero();
      result.point2.setZero();
      for (int k = 0; k < 3; ++k) {
        result.point1 += weight[k] * vertices_[face.vertex[k]].point1;
        result.point2 += weight[k] * vertices_[face.vertex[k]].point2;
      }
      if ((result.point2 - result.point1 - depth * normal).norm() <= flat) return true;
    }
    return false;
  }

 private:
  const Vector3d& at(int vertex) const { return vertices_[vertex].difference; }

  void add_face(int a, int b, int c) {
    Face face;
    face.vertex = {a, b, c};
    const Vector3d edge1 = at(b) - at(a), edge2 = at(c) - at(a);
    const Vector3d normal = edge1.cross(edge2);
    const double area = normal.norm();
    if (area > kSliver * edge1.norm() * edge2.norm()) {
      face.normal = normal / area;
      face.offset = face.normal.dot(at(a));
    }
    faces_.push_back(face);
  }

  // Keeps the edges of the faces that gave way which only one of them has.
  void add_to_rim(int from, int to) {
    const auto twin = std::find(rim_.begin(), rim_.end(), std::pair(to, from));
    if (twin == rim_.end()) {
      rim_.emplace_back(from, to);
    } else {
      *twin = rim_.back();
      rim_.pop_back();
    }
  }

  std::vector<DifferencePoint> vertices_;
  std::vector<Face> faces_;
  std::vector<std::pair<int, int>> rim_;
};

}  // namespace

std::optional<Penetration> expand_polytope(const Shape& shape1, const Pose& pose1,
                                           const Shape& shape2, const Pose& pose2) {
  const double size = core_extent(shape1) + core_extent(shape2);
  const auto furthest = [&](const Vector3d& direction) {
    return difference_support(shape1, pose1, shape2, pose2, -direction);
  };

  // Four corners, each as far as can be from the span of those before.
  std::array<DifferencePoint, 4> corner;
  corner[0] = furthest(Vector3d::UnitX());
  corner[1] = furthest(-Vector3d::UnitX());
  const Vector3d line = corner[1].difference - corner[0].difference;
  if (line.norm() <= kFlat * size) return std::nullopt;
  const Vector3d side = line.unitOrthogonal();
  double widest = 0.0;
  for (const Vector3d& direction : {side, Vector3d(-side), Vector3d(line.cross(side).normalized()),
                                    Vector3d(-line.cross(side).normalized())}) {
    const DifferencePoint point = furthest(direction);
    const double width = (point.difference - corner[0].difference).cross(line.normalized()).norm();
    if (width > widest) {
      widest = width;
      corner[2] = point;
    }
  }
  if (widest <= kFlat * size) return std::nullopt;
  const Vector3d up = line.cross(corner[2].difference - corner[0].difference).normalized();
  const DifferencePoint above = furthest(up), below = furthest(-up);
  const double height = up.dot(above.difference - corner[0].difference);
  const double depth = up.dot(corner[0].difference - below.difference);
  corner[3] = height >= depth ? above : below;
  thread_local Polytope polytope;  // kept by the thread: no allocation in a step
  if (!polytope.start(corner, kFlat * size)) return std::nullopt;

  Penetration best;
  best.distance.distance = -kInfinity;
  for (int round = 0; round < kMaxRounds; ++round) {
    const int nearest = polytope.nearest();
    const Face face = polytope.face(nearest);
    if (face.offset == kInfinity) break;
    const DifferencePoint point = furthest(face.normal);
    const double reach = face.normal.dot(point.difference);
    best.bound = -face.offset;
    const bool meet = reach - face.offset <= kTolerance * size;
    if (meet || -reach > best.distance.distance) {
      best.distance.distance = -reach;
      best.distance.normal = -face.normal;
    }
    if (meet)
      best.exact = polytope.find_witness(reach, face.normal, kTolerance * size, best.distance);
    const double gap = best.bound - best.distance.distance;
    if (meet || (round >= kPatience && gap <= kImpatientTolerance * size)) break;
    polytope.grow(point, nearest, 0.1 * kFlat * size);
    if (polytope.face_count() > kMaxFaces) break;
  }
  return best;
}

}  // namespace dashpot
