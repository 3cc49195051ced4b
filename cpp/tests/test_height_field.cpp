// Distances and times of impact of a height field.

#include <random>
#include <vector>

#include "checks.hpp"
#include "dashpot/geometry/pair_motion.hpp"
#include "dashpot/geometry/query.hpp"

namespace {

using namespace dashpot;

std::mt19937 generator(3);

double uniform(double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(generator);
}

// Shapes over, beside and falling onto a height field of more than one block of cells.
void check_height_field() {
  std::vector<float> heights(40 * 30);
  for (float& height : heights) height = static_cast<float>(uniform(0.0, 1.0));
  Shape field;
  field.type = ShapeType::kHeightField;
  field.field.rows = 40;
  field.field.columns = 30;
  field.field.half_x = field.field.half_y = 1.0;
  field.field.elevation = 0.1;
  field.field.base = 0.2;
  field.field.heights = heights.data();
  Shape box;
  box.type = ShapeType::kBox;
  box.size << 0.1, 0.2, 0.3;
  int met = 0;
  for (int trial = 0; trial < 100; ++trial) {
    Pose pose;
    pose.position << uniform(-2.0, 2.0), uniform(-2.0, 2.0), uniform(0.6, 1.0);
    Motion fall;
    fall.centre = pose.position;
    fall.linear.z() = -1.0;
    fall.angular << 0.0, uniform(-3.0, 3.0), uniform(-1.0, 1.0);
    const double apart = distance(field, {}, box, pose).distance;
    const auto impact = time_of_impact(field, {}, {}, box, pose, fall, 1.0);
    const double then = distance(field, {}, box, advance(pose, fall, impact.time)).distance;
    met += impact.hit;
    check(apart > 0.0 && then > -1e-12, "a height field is not met late");
    check(!impact.hit || then < 1e-8, "a height field is met where it is");
    pose.position.z() = -0.2;
    const bool above = pose.position.head<2>().cwiseAbs().maxCoeff() < 1.0;
    check(!above || distance(field, {}, box, pose).distance < 0.0,
          "what is in a height field overlaps it");
  }
  check(met > 10, "what falls on a height field meets it");
}

}  // namespace

int main() {
  check_height_field();
  return exit_status();
}
