#include "dashpot/height_field.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "dashpot/prisms.hpp"

namespace dashpot {

using Eigen::AlignedBox3d;
using Eigen::Vector3d;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// The pose of a shape seen from the frame of another.
Pose relative_pose(const Pose& frame, const Pose& pose) {
  return {frame.rotation.transpose() * (pose.position - frame.position),
          frame.rotation.transpose() * pose.rotation};
}

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

// Signed distance of two boxes along their common axes: a lower bound for what they hold.
double box_distance(const AlignedBox3d& box1, const AlignedBox3d& box2) {
  const Vector3d gap = (box1.min() - box2.max()).cwiseMax(box2.min() - box1.max());
  const double largest = gap.maxCoeff();
  return largest <= 0.0 ? largest : gap.cwiseMax(0.0).norm();
}

using Candidate = std::pair<double, int>;  // lower bound of the signed distance, prism

// Directions that were shortest for other prisms, and how far the shape reaches towards the field.
class Directions {
 public:
  Directions(const Shape& shape, const Pose& pose) : shape_(shape), pose_(pose) {}

  void add(const Vector3d& normal) {
    for (int i = 0; i < count_; ++i) {
      if ((normal_[i] - normal).squaredNorm() < kSame * kSame) return;
    }
    const int slot = next_++ % kKept;
    count_ = std::min(count_ + 1, kKept);
    normal_[slot] = normal;
    lowest_[slot] = normal.dot(core_support(shape_, pose_, -normal)) - sweep_radius(shape_);
  }

  // Lower bound of the signed distance from the prism to the shape.
  double bound(const Prism& prism) const {
    double best = -kInfinity;
    for (int i = 0; i < count_; ++i) {
      best = std::max(best, lowest_[i] - prism.reach(normal_[i]));
    }
    return best;
  }

 private:
  static constexpr int kKept = 8;
  static constexpr double kSame = 1e-3;  // rad
  const Shape& shape_;
  const Pose pose_;  // in the field's frame
  std::array<Vector3d, kKept> normal_;
  std::array<double, kKept> lowest_{};
  int count_ = 0, next_ = 0;
};

}  // namespace

AlignedBox3d height_field_box(const HeightField& field) {
  const Prisms prisms(field);
  AlignedBox3d box;
  for (int i = 0; i < prisms.count(); ++i) box.extend(prisms.at(i).box());
  return box;
}

Shape height_field_hull(const HeightField& field) {
  const Prisms prisms(field);
  auto corners = std::make_shared<Eigen::Matrix3Xd>(3, 6 * prisms.count());
  Eigen::Index used = 0;
  for (int i = 0; i < prisms.count(); ++i) {
    for (const Vector3d& top : prisms.at(i).top) {
      corners->col(used++) = top;
      corners->col(used++) << top.x(), top.y(), -field.base;
    }
  }
  Shape hull;
  hull.type = ShapeType::kHull;
  hull.vertices = corners;
  return hull;
}

Distance height_field_distance(const HeightField& field, const Pose& field_pose, const Shape& shape,
                               const Pose& pose) {
  const Prisms prisms(field);
  const Pose local = relative_pose(field_pose, pose);
  const AlignedBox3d box = bounding_box(shape, local);
  PlacedPrism placed(field_pose);
  Directions directions(shape, local);
  Distance best;
  best.distance = kInfinity;
  const auto measure = [&](const Prism& prism) {
    placed.set(prism);
    const Distance found = distance(placed.shape(), placed.pose(), shape, pose);
    directions.add(field_pose.rotation.transpose() * found.normal);
    if (found.distance < best.distance) best = found;
  };
  measure(prisms.at(prisms.beneath(box.center())));

  std::vector<Candidate> candidates;
  prisms.visit(inflated(box, std::max(best.distance, 0.0)), [&](int index) {
    const double bound = box_distance(prisms.at(index).box(), box);
    if (bound < best.distance) candidates.emplace_back(bound, index);
  });
  std::sort(candidates.begin(), candidates.end());
  for (const auto& [bound, index] : candidates) {
    if (bound >= best.distance) break;
    const Prism prism = prisms.at(index);
    if (directions.bound(prism) < best.distance) measure(prism);
  }
  return best;
}

TimeOfImpact height_field_time_of_impact(const HeightField& field, const Pose& field_pose,
                                         const Motion& field_motion, const Shape& shape,
                                         const Pose& pose, const Motion& motion, double horizon,
                                         double margin) {
  const auto later = [](const Motion& m, double time) {
    return Motion{m.centre + time * m.linear, m.linear, m.angular};
  };
  // Bounds on the motion of the shape as the field sees it: a drift that all points share, in the
  // direction of the field's axes, and what turning adds.
  const double arm = (pose.position - motion.centre).norm() + core_extent(shape);
  const Vector3d drift = motion.linear - field_motion.linear;
  const double field_arm =
      (motion.centre - field_motion.centre).norm() + drift.norm() * horizon + arm;
  const double field_turn = field_motion.angular.norm() * field_arm;
  const double turn = motion.angular.norm() * arm;
  const double speed = drift.norm() + turn + field_turn;

  TimeOfImpact result;
  result.at = height_field_distance(field, field_pose, shape, pose);
  result.evaluations = 1;
  if (result.at.distance <= margin) {
    result.hit = true;
    return result;
  }

  const Prisms prisms(field);
  const AlignedBox3d whole = height_field_box(field);
  const double touching =
      kTouchingGap * (core_extent(shape) + sweep_radius(shape) + whole.diagonal().norm());
  double time = 0.0;
  std::vector<Candidate> candidates;
  while (time < horizon) {
    const Pose field_now = advance(field_pose, field_motion, time);
    const Pose now = advance(pose, motion, time);
    const Pose local = relative_pose(field_now, now);
    const AlignedBox3d box = inflated(bounding_box(shape, local), margin + touching);
    const auto swept = [&](double length) {
      const Vector3d moved = field_now.rotation.transpose() * drift * length;
      const AlignedBox3d end(box.min() + moved, box.max() + moved);
      return inflated(box.merged(end), std::min(turn * length, 2.0 * arm) + field_turn * length);
    };
    if (!swept(horizon - time).intersects(whole)) break;
    const double size = std::max(box.diagonal().norm(), prisms.cell_size());
    const double window = std::min(horizon - time, std::max(size / (drift.norm() + field_turn),
                                                            box_distance(box, whole) / speed));
    const AlignedBox3d sweep = swept(window);

    candidates.clear();
    prisms.visit(sweep, [&](int index) {
      const AlignedBox3d prism_box = prisms.at(index).box();
      if (prism_box.intersects(sweep)) candidates.emplace_back(box_distance(prism_box, box), index);
    });
    std::sort(candidates.begin(), candidates.end());
    PlacedPrism placed(field_now);
    double left = window;
    for (const auto& [bound, index] : candidates) {
      if (bound > speed * left) break;
      placed.set(prisms.at(index));
      const TimeOfImpact found =
          time_of_impact(placed.shape(), placed.pose(), later(field_motion, time), shape, now,
                         later(motion, time), left, margin);
      result.evaluations += found.evaluations;
      if (!found.hit) continue;
      result.hit = true;
      result.at = found.at;
      left = found.time;
      if (left == 0.0) break;
    }
    time += left;
    if (result.hit) {
      result.time = time;
      return result;
    }
  }
  result.time = horizon;
  result.at = height_field_distance(field, advance(field_pose, field_motion, horizon), shape,
                                    advance(pose, motion, horizon));
  ++result.evaluations;
  return result;
}

}  // namespace dashpot
