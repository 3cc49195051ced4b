#include "dashpot/geometry/convex_distance.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

namespace dashpot {

using Eigen::Vector3d;

namespace {

// Half as many rounds find distances of 60,000 random pairs of decimetres to 1e-12 m.
constexpr int kMaxGjkRounds = 128;
// Relative to the size of the pair: what rounding leaves of a distance, and the clearance at which
// overlapping cores are compared, large enough for directions to be good to 1e-12 rad.
constexpr double kRoundingOfDistance = 1e-15;
constexpr double kMargin = 1e-3;
constexpr double kStall = 1e-10;    // relative to the size: gap between the bounds of stalled GJK
constexpr double kSettled = 1e-11;  // rad, of two rounds: ten times what directions are good to
// Sine of a corner of a triangle, and triple product of a tetrahedron's edges to the product of
// their lengths, below which it has no weights of its own: at 1e-16, the rounding of edges, they
// are noise. From a hundredth of this to a hundred times as much distances agree to 1e-10 m.
constexpr double kFlat = 1e-12;
// rad, up to which the direction of the best bound stands for that between the closest points,
// which has lost digits where these are near. Where the two differ by more the bound is an old one.
constexpr double kSameDirection = 1e-6;

struct Simplex {
  std::array<DifferencePoint, 4> vertex;
  std::array<double, 4> weight{};
  int size = 0;
};

// Barycentric weights of the point nearest to the origin on the affine hull of the chosen vertices.
// False where the hull is degenerate or the point lies outside the simplex.
bool affine_weights(const Simplex& simplex, const int* index, int count, double* weight) {
  const Vector3d& origin = simplex.vertex[index[0]].difference;
  if (count == 1) {
    weight[0] = 1.0;
    return true;
  }
  const Vector3d e1 = simplex.vertex[index[1]].difference - origin;
  if (count == 2) {
    const double length = e1.squaredNorm();
    if (length == 0.0) return false;
    weight[1] = -origin.dot(e1) / length;
    weight[0] = 1.0 - weight[1];
  } else if (count == 3) {
    const Vector3d e2 = simplex.vertex[index[2]].difference - origin;
    const Vector3d normal = e1.cross(e2);
    const double area = normal.squaredNorm();
    if (area <= kFlat * kFlat * e1.squaredNorm() * e2.squaredNorm()) return false;
    weight[1] = -normal.dot(origin.cross(e2)) / area;
    weight[2] = -normal.dot(e1.cross(origin)) / area;
    weight[0] = 1.0 - weight[1] - weight[2];
  } else {
    const Vector3d e2 = simplex.vertex[index[2]].difference - origin;
    const Vector3d e3 = simplex.vertex[index[3]].difference - origin;
    const double volume = e1.dot(e2.cross(e3));
    if (std::abs(volume) <= kFlat * e1.norm() * e2.norm() * e3.norm()) return false;
    weight[1] = -origin.dot(e2.cross(e3)) / volume;
    weight[2] = -e1.dot(origin.cross(e3)) / volume;
    weight[3] = -e1.dot(e2.cross(origin)) / volume;
    weight[0] = 1.0 - weight[1] - weight[2] - weight[3];
  }
  return *std::min_element(weight, weight + count) >= 0.0;
}

// Reduces the simplex to the face that holds the point nearest to the origin, which it returns.
Vector3d nearest_point(Simplex& simplex) {
  double best = std::numeric_limits<double>::infinity();
  Simplex nearest;
  Vector3d nearest_difference = Vector3d::Zero();
  for (int subset = 1; subset < (1 << simplex.size); ++subset) {
    std::array<int, 4> index{};
    int count = 0;
    for (int i = 0; i < simplex.size; ++i)
      if (subset & (1 << i)) index[count++] = i;
    std::array<double, 4> weight{};
    if (!affine_weights(simplex, index.data(), count, weight.data())) continue;
    Vector3d point = Vector3d::Zero();
    for (int i = 0; i < count; ++i) point += weight[i] * simplex.vertex[index[i]].difference;
    // A tetrahedron that holds the origin is at distance zero, whatever rounding leaves.
    const double distance = count == 4 ? 0.0 : point.squaredNorm();
    if (distance >= best) continue;
    best = distance;
    nearest_difference = count == 4 ? Vector3d::Zero() : point;
    nearest.size = count;
    for (int i = 0; i < count; ++i) {
      nearest.vertex[i] = simplex.vertex[index[i]];
      nearest.weight[i] = weight[i];
    }
  }
  simplex = nearest;
  return nearest_difference;
}

double pair_size(const Shape& shape1, const Pose& pose1, const Shape& shape2, const Pose& pose2) {
  return core_extent(shape1) + core_extent(shape2) + (pose2.position - pose1.position).norm();
}

}  // namespace

DifferencePoint difference_support(const Shape& shape1, const Pose& pose1, const Shape& shape2,
                                   const Pose& pose2, const Vector3d& normal) {
  DifferencePoint vertex;
  vertex.point1 = core_support(shape1, pose1, normal);
  vertex.point2 = core_support(shape2, pose2, -normal);
  vertex.difference = vertex.point2 - vertex.point1;
  return vertex;
}

std::optional<Distance> separated_distance(const Shape& shape1, const Pose& pose1,
                                           const Shape& shape2, const Pose& pose2,
                                           const Vector3d& start, double enough) {
  const double tolerance = kRoundingOfDistance * pair_size(shape1, pose1, shape2, pose2);
  Simplex simplex;
  simplex.vertex[0] = difference_support(shape1, pose1, shape2, pose2, start.normalized());
  simplex.weight[0] = 1.0;
  simplex.size = 1;
  Vector3d nearest = simplex.vertex[0].difference;
  double upper = nearest.norm();
  double lower = -std::numeric_limits<double>::infinity();
  Vector3d normal = start.normalized();
  for (int round = 0; round < kMaxGjkRounds && upper > tolerance; ++round) {
    const Vector3d direction = nearest / upper;
    const DifferencePoint vertex = difference_support(shape1, pose1, shape2, pose2, direction);
    const double bound = vertex.difference.dot(direction);
    if (bound > lower) {
      lower = bound;
      normal = direction;
    }
    if (upper - lower <= tolerance || lower > enough) break;
    Simplex grown = simplex;
    grown.vertex[grown.size++] = vertex;
    const Vector3d closer = nearest_point(grown);
    const double distance = closer.norm();
    if (distance >= upper) break;  // rounding: no closer point can be represented
    simplex = grown;
    nearest = closer;
    upper = distance;
  }
  if (upper <= tolerance) return std::nullopt;

  Distance result;
  for (int i = 0; i < simplex.size; ++i) {
    result.point1 += simplex.weight[i] * simplex.vertex[i].point1;
    result.point2 += simplex.weight[i] * simplex.vertex[i].point2;
  }
  result.distance = upper;
  result.normal = nearest / upper;
  if (lower > 0.0 && (normal - result.normal).norm() < kSameDirection) result.normal = normal;
  return result;
}

Distance refine_distance(const Shape& shape1, const Pose& pose1, const Shape& shape2,
                         const Pose& pose2, const Vector3d& start, int rounds) {
  const double size = pair_size(shape1, pose1, shape2, pose2);
  const double margin = kMargin * size;
  const auto height = [&](const Vector3d& normal) {
    return difference_support(shape1, pose1, shape2, pose2, normal);
  };
  const DifferencePoint first = height(start);
  Distance best{first.difference.dot(start), first.point1, first.point2, start};
  Vector3d normal = start, centre = start;  // centre: where the next round moves the cores apart
  double lower = best.distance, centre_height = lower;
  int momentum = 0;
  for (int round = 0; round < rounds; ++round) {
    const double shift = std::max(0.0, margin - centre_height);
    Pose moved = pose2;
    moved.position += shift * centre;
    const auto apart = separated_distance(shape1, pose1, shape2, moved, centre);
    if (!apart) break;
    const Vector3d turned = apart->normal;
    const double raised = height(turned).difference.dot(turned);
    const bool settled = (turned - centre).norm() <= kSettled;
    if (round == 0 || raised >= lower - kStall * size)
      best = {raised, apart->point1, apart->point2 - shift * centre, turned};
    if (shift == 0.0 || settled) break;
    if (raised < lower) {  // the momentum overshot, or rounding is all that is left
      if (momentum == 0) break;
      momentum = 0;
      centre = normal;
      centre_height = lower;
      continue;
    }
    // Nesterov's momentum, which takes the square root of the number of rounds.
    const double carry = momentum / (momentum + 3.0);
    ++momentum;
    centre = (turned + carry * (turned - normal)).normalized();
    normal = turned;
    lower = raised;
    centre_height = height(centre).difference.dot(centre);
  }
  best.distance = (best.point2 - best.point1).dot(best.normal);
  return best;
}

}  // namespace dashpot
