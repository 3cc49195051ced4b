#include "dashpot/geometry/hull.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "dashpot/lanes/instruction_sets.hpp"
#include "dashpot/lanes/lanes.hpp"

namespace dashpot {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

namespace {

// Fractions of the radius: what may stand out, and from where on a facet sees a point.
constexpr double kStandsOut = 5e-5;
constexpr double kSees = 1e-9;

class Quickhull {
 public:
  Quickhull(const Matrix3Xd& vertices, double radius)
      : vertices_(vertices), stands_out_(kStandsOut * radius), sees_(kSees * radius) {
    if (!start()) return;
    for (size_t i = 0; i < facet_.size(); ++i)
      while (!facet_[i].gone && !facet_[i].beyond.empty()) grow(static_cast<int>(i));
  }

  // Its facets, their corners columns of the vertices.
  std::vector<HullFacet> facets() const {
    std::vector<int> place;
    int count = 0;
    for (const Facet& facet : facet_) place.push_back(facet.gone ? -1 : count++);
    std::vector<HullFacet> facets;
    for (const Facet& facet : facet_) {
      if (facet.gone) continue;
      facets.push_back(facet);
      for (int& across : facets.back().across) across = place[across];
    }
    return facets;
  }

 private:
  struct Facet : HullFacet {
    Vector3d normal = Vector3d::Zero();
    double offset = 0.0;
    std::vector<int> beyond;  // vertices that stand out of it
    bool gone = false;
  };
  struct Edge {
    int from, to, kept;
  };

  double height(const Facet& facet, int vertex) const {
    return facet.normal.dot(vertices_.col(vertex)) - facet.offset;
  }

  void add_facet(const std::array<int, 3>& corner, const std::array<int, 3>& across) {
    Facet facet;
    facet.corner = corner;
    facet.across = across;
    const Vector3d first = vertices_.col(corner[0]);
    facet.normal =
        (vertices_.col(corner[1]) - first).cross(vertices_.col(corner[2]) - first).normalized();
    facet.offset = facet.normal.dot(first);
    facet_.push_back(std::move(facet));
  }

  // Hands each to the first of the facets from `first` on that it stands out of.
  void hand_out(const std::vector<int>& vertices, size_t first) {
    for (int vertex : vertices) {
      const auto facet = std::find_if(facet_.begin() + first, facet_.end(), [&](const Facet& here) {
        return height(here, vertex) > stands_out_;
      });
      if (facet != facet_.end()) facet->beyond.push_back(vertex);
    }
  }

  // A tetrahedron of vertices that lie far apart; false where they span no volume.
  bool start() {
    Eigen::Index a, b, c, d;
    vertices_.row(0).maxCoeff(&a);
    const auto arm = (vertices_.colwise() - vertices_.col(a)).eval();
    arm.colwise().squaredNorm().maxCoeff(&b);
    const Vector3d along = arm.col(b);
    arm.colwise().cross(along).colwise().squaredNorm().maxCoeff(&c);
    const Vector3d normal = along.cross(arm.col(c)).normalized();
    const double height = (normal.transpose() * arm).cwiseAbs().maxCoeff(&d);
    if (!(height > stands_out_)) return false;
    if (normal.dot(arm.col(d)) > 0.0) std::swap(c, d);
    const int i = static_cast<int>(a), j = static_cast<int>(b), k = static_cast<int>(c),
              l = static_cast<int>(d);
    add_facet({i, j, k}, {1, 2, 3});
    add_facet({i, l, j}, {3, 2, 0});
    add_facet({j, l, k}, {1, 3, 0});
    add_facet({k, l, i}, {2, 1, 0});
    std::vector<int> all(vertices_.cols());
    std::iota(all.begin(), all.end(), 0);
    hand_out(all, 0);
    return true;
  }

  // Takes in a facet's farthest vertex: facets that see it give way to a cone from their rim.
  void grow(int seed) {
    std::vector<int>& beyond = facet_[seed].beyond;
    const auto apex_at = std::max_element(beyond.begin(), beyond.end(), [&](int v, int w) {
      return height(facet_[seed], v) < height(facet_[seed], w);
    });
    const int apex = *apex_at;
    beyond.erase(apex_at);
    std::vector<int> seeing{seed};
    facet_[seed].gone = true;
    for (size_t i = 0; i < seeing.size(); ++i)
      for (int next : facet_[seeing[i]].across) {
        if (facet_[next].gone || height(facet_[next], apex) <= sees_) continue;
        facet_[next].gone = true;
        seeing.push_back(next);
      }
    std::vector<Edge> rim;
    for (int i : seeing)
      for (int k = 0; k < 3; ++k)
        if (const int next = facet_[i].across[k]; !facet_[next].gone)
          rim.push_back({facet_[i].corner[k], facet_[i].corner[(k + 1) % 3], next});
    if (!put_in_order(rim)) {  // torn by rounding
      for (int i : seeing) facet_[i].gone = false;
      return;
    }
    const int first = static_cast<int>(facet_.size()), count = static_cast<int>(rim.size());
    for (int i = 0; i < count; ++i) {
      const auto [from, to, kept] = rim[i];
      add_facet({from, to, apex}, {kept, first + (i + 1) % count, first + (i + count - 1) % count});
      for (int k = 0; k < 3; ++k)
        if (facet_[kept].corner[k] == to) facet_[kept].across[k] = first + i;
    }
    for (int i : seeing) hand_out(std::exchange(facet_[i].beyond, {}), first);
  }

  // Whether they lead around once.
  static bool put_in_order(std::vector<Edge>& rim) {
    for (size_t i = 0; i + 1 < rim.size(); ++i) {
      const auto next = std::find_if(rim.begin() + i + 1, rim.end(),
                                     [&](const Edge& edge) { return edge.from == rim[i].to; });
      if (next == rim.end()) return false;
      std::iter_swap(rim.begin() + i + 1, next);
    }
    return rim.size() > 2 && rim.back().to == rim.front().from;
  }

  const Matrix3Xd& vertices_;
  double stands_out_, sees_;
  std::vector<Facet> facet_;
};

// Index of the first of the points furthest along (dx, dy, dz); `count` > 0: a multiple of kLanes.
DASHPOT_VECTOR_CLONES
int find_furthest(const double* x, const double* y, const double* z, int count, double dx,
                  double dy, double dz) {
  Lanes furthest = all_lanes(-std::numeric_limits<double>::infinity());
  Lanes where{}, at{0.0, 1.0, 2.0, 3.0};
  for (int i = 0; i < count; i += kLanes) {
    const Lanes height = dx * load_lanes(x + i) + dy * load_lanes(y + i) + dz * load_lanes(z + i);
    const LaneMask further = height > furthest;
    furthest = select(further, height, furthest);
    where = select(further, at, where);
    at += static_cast<double>(kLanes);
  }
  int best = 0;
  for (int lane = 1; lane < kLanes; ++lane)
    if (furthest[lane] > furthest[best] ||
        (furthest[lane] == furthest[best] && where[lane] < where[best]))
      best = lane;
  return static_cast<int>(where[best]);
}

}  // namespace

Vector3d CoarseHull::doubled_area(const HullFacet& of) const {
  const Vector3d first = corner.col(of.corner[0]);
  return (corner.col(of.corner[1]) - first).cross(corner.col(of.corner[2]) - first);
}

int CoarseHull::farthest(const Vector3d& direction, int from) const {
  double greatest = direction.dot(corner.col(from));
  for (int at = from;;) {
    for_next(from, [&](int next) {
      const double along = direction.dot(corner.col(next));
      if (along <= greatest) return;
      greatest = along;
      at = next;
    });
    if (at == from) return at;
    from = at;
  }
}

CoarseHull coarse_hull(const Matrix3Xd& vertices) {
  CoarseHull hull;
  if (vertices.cols() == 0) return hull;
  const Vector3d centre = 0.5 * (vertices.rowwise().minCoeff() + vertices.rowwise().maxCoeff());
  hull.radius = std::sqrt((vertices.colwise() - centre).colwise().squaredNorm().maxCoeff());
  hull.facet = Quickhull(vertices, hull.radius).facets();
  std::vector<int> corner_of(vertices.cols(), -1), given;
  for (HullFacet& facet : hull.facet)
    for (int& corner : facet.corner) {
      if (corner_of[corner] < 0) {
        corner_of[corner] = static_cast<int>(given.size());
        given.push_back(corner);
      }
      corner = corner_of[corner];
    }
  hull.corner = vertices(Eigen::all, given);
  hull.around_begin.assign(given.size() + 1, 0);
  for (const HullFacet& facet : hull.facet)
    for (int corner : facet.corner) ++hull.around_begin[corner + 1];
  std::partial_sum(hull.around_begin.begin(), hull.around_begin.end(), hull.around_begin.begin());
  hull.around.resize(3 * hull.facet.size());
  std::vector<int> next(hull.around_begin);
  for (size_t i = 0; i < hull.facet.size(); ++i)
    for (int corner : hull.facet[i].corner) hull.around[next[corner]++] = static_cast<int>(i);
  return hull;
}

void Hull::set(const Eigen::Ref<const Eigen::Matrix3Xd>& corners) {
  count_ = static_cast<int>(corners.cols());
  for (AlignedDoubles* coordinate : {&x_, &y_, &z_}) coordinate->resize(padded(count_));
  for (int i = 0; i < padded(count_); ++i) {
    const auto corner = corners.col(std::min(i, count_ - 1));
    x_[i] = corner.x();
    y_[i] = corner.y();
    z_[i] = corner.z();
  }
  extent_ = count_ > 0 ? corners.colwise().norm().maxCoeff() : 0.0;
}

bool Hull::is_finite() const {
  const auto finite = [](double value) { return std::isfinite(value); };
  for (const AlignedDoubles* coordinate : {&x_, &y_, &z_})
    if (!std::all_of(coordinate->begin(), coordinate->end(), finite)) return false;
  return true;
}

Vector3d Hull::furthest_along(const Vector3d& direction) const {
  return corner(find_furthest(x_.data(), y_.data(), z_.data(), padded(count_), direction.x(),
                              direction.y(), direction.z()));
}

}  // namespace dashpot
