#include "height_field.hpp"

#include <algorithm>
#include <array>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "moving_shape.hpp"
#include "prisms.hpp"

namespace dashpot {

using Eigen::AlignedBox3d;
using Eigen::Vector3d;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// rad, that a window of time allows: turning adds a quarter of the shape's arm to what it sweeps.
constexpr double kTurnOfWindow = 0.25;

// Signed distance of two boxes along their common axes: a lower bound for what they hold.
double box_distance(const AlignedBox3d& box1, const AlignedBox3d& box2) {
  const Vector3d gap = (box1.min() - box2.max()).cwiseMax(box2.min() - box1.max());
  const double largest = gap.maxCoeff();
  return largest <= 0.0 ? largest : gap.cwiseMax(0.0).norm();
}

using Candidate = std::pair<double, int>;  // lower bound of the signed distance, index

// Directions that were shortest for some prisms, as bounds for others. `Lowest` gives the least
// height of the shape along a direction.
template <typename Lowest>
class Directions {
 public:
  explicit Directions(const Lowest& lowest) : lowest_of_(lowest) {}

  void add(const Vector3d& normal) {
    for (int i = 0; i < count_; ++i)
      if ((normal_[i] - normal).squaredNorm() < kSame * kSame) return;
    const int slot = next_++ % kKept;
    count_ = std::min(count_ + 1, kKept);
    normal_[slot] = normal;
    lowest_[slot] = lowest_of_(normal);
  }

  // After a change of what `Lowest` answers.
  void refresh() {
    for (int i = 0; i < count_; ++i) lowest_[i] = lowest_of_(normal_[i]);
  }

  // Whether some direction proves the prism to be further from the shape than `distance`.
  bool prove_further(const Prism& prism, double distance) const {
    for (int i = 0; i < count_; ++i)
      if (lowest_[i] - prism.reach(normal_[i]) >= distance) return true;
    return false;
  }
  bool prove_further(const AlignedBox3d& box, double distance) const {
    for (int i = 0; i < count_; ++i) {
      const double reach =
          normal_[i].dot(box.center()) + 0.5 * normal_[i].cwiseAbs().dot(box.sizes());
      if (lowest_[i] - reach >= distance) return true;
    }
    return false;
  }

 private:
  static constexpr int kKept = 8;
  // rad, up to which directions are the same: their distances differ by a thousandth of the sizes.
  static constexpr double kSame = 1e-3;
  Lowest lowest_of_;
  std::array<Vector3d, kKept> normal_;
  std::array<double, kKept> lowest_{};
  int count_ = 0, next_ = 0;
};

Motion later(const Motion& m, double time) {
  return Motion{m.centre + time * m.linear, m.linear, m.angular};
}

// Of a part of the way: poses and motions at its start, and the box of the shape there as the field
// sees it; how long it lasts, s.
struct Window {
  Pose field_pose, pose;
  Motion field_motion, motion;
  Pose local{};
  AlignedBox3d box{};
  double length = 0.0;
};

// Bounds on the motion of a shape as a field sees it: a drift that all points share, in the
// direction of the field's axes, and what turning adds.
struct SweptMotion {
  SweptMotion(const Motion& field_motion, const Shape& shape, const Pose& pose,
              const Motion& motion, double horizon)
      : drift(motion.linear - field_motion.linear),
        arm((pose.position - motion.centre).norm() + core_extent(shape)),
        turn(motion.angular.norm() * arm) {
    const double field_arm =
        (motion.centre - field_motion.centre).norm() + drift.norm() * horizon + arm;
    field_turn = field_motion.angular.norm() * field_arm;
    speed = drift.norm() + turn + field_turn;
  }

  // What the box of a window sweeps in `length` (s).
  AlignedBox3d swept(const Window& window, double length) const {
    const Vector3d moved = window.field_pose.rotation.transpose() * drift * length;
    const AlignedBox3d end(window.box.min() + moved, window.box.max() + moved);
    return inflated(window.box.merged(end),
                    std::min(turn * length, 2.0 * arm) + field_turn * length);
  }

  Vector3d drift;
  double arm, turn, field_turn, speed;
};

// How long (s) into a window the shape meets no prism, at most all of it; notes in `result` what it
// meets then. In the frame of the field, which bounds hold for as long as it does not turn.
double free_time(const Prisms& prisms, const Window& window, const SweptMotion& bounds,
                 const Shape& shape, double margin, double touching,
                 std::vector<Candidate>& candidates, TimeOfImpact& result) {
  const AlignedBox3d sweep = bounds.swept(window, window.length);
  double left = window.length;
  const auto to_field = [&](const Vector3d& v) -> Vector3d {
    return window.field_pose.rotation.transpose() * v;
  };
  const MovingShape moving =
      make_moving(shape, window.local,
                  {to_field(window.motion.centre - window.field_pose.position),
                   to_field(bounds.drift), to_field(window.motion.angular)});
  Directions directions([&](const Vector3d& normal) {
    return std::min(moving.height(normal, -1.0, 0.0), moving.height(normal, -1.0, left));
  });
  candidates.clear();
  for (const CellRange& block : Prisms::blocks(prisms.cells(sweep))) {
    if (!prisms.box(block).intersects(sweep)) continue;
    prisms.visit(block, [&](int index, const Prism& prism) {
      const AlignedBox3d prism_box = prism.box();
      if (prism_box.intersects(sweep))
        candidates.emplace_back(box_distance(prism_box, window.box), index);
    });
  }
  std::sort(candidates.begin(), candidates.end());
  PlacedPrism placed(window.field_pose);
  for (const auto& [bound, index] : candidates) {
    if (bound > bounds.speed * left) break;
    const Prism prism = prisms.at(index);
    if (directions.prove_further(prism, margin + touching)) continue;
    placed.set(prism);
    const TimeOfImpact found = time_of_impact(placed.shape(), placed.pose(), window.field_motion,
                                              shape, window.pose, window.motion, left, margin);
    result.evaluations += found.evaluations;
    if (found.hit) {
      result.hit = true;
      result.at = found.at;
      left = found.time;
      directions.refresh();
    }
    if (left == 0.0) break;
    if (bounds.field_turn == 0.0) directions.add(to_field(found.at.normal));
  }
  return left;
}

}  // namespace

AlignedBox3d bounding_box(const Shape& shape, const Pose& pose) {
  AlignedBox3d box;
  const double radius = sweep_radius(shape);
  for (int axis = 0; axis < 3; ++axis) {
    const Vector3d direction = Vector3d::Unit(axis);
    box.max()[axis] = core_support(shape, pose, direction)[axis] + radius;
    box.min()[axis] = core_support(shape, pose, -direction)[axis] - radius;
  }
  return box;
}

AlignedBox3d inflated(AlignedBox3d box, double by) {
  box.min().array() -= by;
  box.max().array() += by;
  return box;
}

AlignedBox3d height_field_box(const HeightField& field) {
  const Prisms prisms(field);
  return prisms.box(prisms.all());
}

Shape height_field_hull(const HeightField& field) {
  const Prisms prisms(field);
  std::vector<Vector3d> corners;
  prisms.visit(prisms.all(), [&](int, const Prism& prism) {
    for (const Vector3d& top : prism.top) {
      corners.push_back(top);
      corners.emplace_back(top.x(), top.y(), -field.base);
    }
  });
  Shape hull;
  hull.type = ShapeType::kHull;
  hull.hull = std::make_shared<const Hull>(
      Eigen::Map<const Eigen::Matrix3Xd>(corners.front().data(), 3, corners.size()));
  return hull;
}

Distance height_field_distance(const HeightField& field, const Pose& field_pose, const Shape& shape,
                               const Pose& pose) {
  const Prisms prisms(field);
  const Pose local = relative_pose(field_pose, pose);
  const AlignedBox3d box = bounding_box(shape, local);
  PlacedPrism placed(field_pose);
  Directions directions([&](const Vector3d& normal) {
    return normal.dot(core_support(shape, local, -normal)) - sweep_radius(shape);
  });
  Distance best;
  best.distance = kInfinity;
  const auto measure = [&](const Prism& prism) {
    placed.set(prism);
    const Distance found = distance(placed.shape(), placed.pose(), shape, pose);
    directions.add(field_pose.rotation.transpose() * found.normal);
    if (found.distance < best.distance) best = found;
  };
  measure(prisms.at(prisms.beneath(box.center())));

  // Least bound first: blocks of cells (below zero, complemented) give way to their prisms.
  const std::vector<CellRange> blocks =
      Prisms::blocks(prisms.cells(inflated(box, std::max(best.distance, 0.0))));
  std::vector<Candidate> heap;
  const auto push = [&](double bound, int index) {
    if (bound >= best.distance) return;
    heap.emplace_back(bound, index);
    std::push_heap(heap.begin(), heap.end(), std::greater<>());
  };
  for (std::size_t i = 0; i < blocks.size(); ++i)
    push(box_distance(prisms.box(blocks[i]), box), ~static_cast<int>(i));
  while (!heap.empty() && heap.front().first < best.distance) {
    const int index = heap.front().second;
    std::pop_heap(heap.begin(), heap.end(), std::greater<>());
    heap.pop_back();
    if (index >= 0) {
      const Prism prism = prisms.at(index);
      if (!directions.prove_further(prism, best.distance)) measure(prism);
    } else if (!directions.prove_further(prisms.box(blocks[~index]), best.distance)) {
      prisms.visit(blocks[~index], [&](int inner, const Prism& prism) {
        push(box_distance(prism.box(), box), inner);
      });
    }
  }
  return best;
}

TimeOfImpact height_field_time_of_impact(const HeightField& field, const Pose& field_pose,
                                         const Motion& field_motion, const Shape& shape,
                                         const Pose& pose, const Motion& motion, double horizon,
                                         double margin) {
  const SweptMotion bounds(field_motion, shape, pose, motion, horizon);
  const auto distance_at = [&](double time) {
    return height_field_distance(field, advance(field_pose, field_motion, time), shape,
                                 advance(pose, motion, time));
  };
  const Prisms prisms(field);
  const AlignedBox3d whole = height_field_box(field);
  const double touching =
      kTouchingGap * (core_extent(shape) + sweep_radius(shape) + whole.diagonal().norm());
  TimeOfImpact result;
  std::vector<Candidate> candidates;
  for (int windows = 0; result.time < horizon; ++windows) {
    if (result.evaluations + windows > kMostDistancesToField)
      throw UndecidedImpact("time of impact: no decision in " +
                            std::to_string(kMostDistancesToField) +
                            " distances and parts of the way");
    Window window{advance(field_pose, field_motion, result.time),
                  advance(pose, motion, result.time), later(field_motion, result.time),
                  later(motion, result.time)};
    window.local = relative_pose(window.field_pose, window.pose);
    window.box = inflated(bounding_box(shape, window.local), margin + touching);
    const double remaining = horizon - result.time;
    if (!bounds.swept(window, remaining).intersects(whole)) break;
    const double size = std::max(window.box.diagonal().norm(), prisms.cell_size());
    const double short_motion = std::min(size / (bounds.drift.norm() + bounds.field_turn),
                                         kTurnOfWindow / motion.angular.norm());
    window.length =
        std::min(remaining, std::max(short_motion, box_distance(window.box, whole) / bounds.speed));
    result.time += free_time(prisms, window, bounds, shape, margin, touching, candidates, result);
    if (result.hit) {
      // What overlaps at the start is as deep as its deepest prism.
      if (result.time == 0.0) result.at = distance_at(0.0);
      return result;
    }
  }
  result.time = horizon;
  result.at = distance_at(horizon);
  ++result.evaluations;
  return result;
}

}  // namespace dashpot
