// Micro-steps of one contact whose force is no number.

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

#include "checks.hpp"
#include "dashpot/islands/islands.hpp"
#include "dashpot/solve/microstep.hpp"

namespace {

// A contact whose stiffness is no number pushes nothing and says nothing by itself.
void check_forces_that_are_no_numbers() {
  dashpot::Trees trees;
  const int above[6] = {-1, 0, 1, 2, 3, 4};
  trees.append(0, 6, true, above);
  std::fill_n(trees.inverse.begin(), 3, 1.0);
  dashpot::Rows rows;
  rows.reset(1);
  dashpot::RowGroup& c = rows.append(dashpot::RowKind::kContact, 0, 1, {0, -1});
  c.pair = 0;
  dashpot::PairGeometry geometry;
  geometry.begin = {trees.tree[0].begin, 0};
  geometry.frame = {0, 0, 1, 1, 0, 0, 0, 1, 0};
  rows.pair.push_back(geometry);
  dashpot::find_inverse_mass(rows, c, trees);
  const int first = 0;
  dashpot::Island island;
  island.tree = island.group = {&first, &first + 1};
  island.microsteps = 16;
  island.duration = 1e-4;
  for (const double stiffness : {1e3, std::numeric_limits<double>::quiet_NaN()}) {
    dashpot::RowData data;
    data.reset_motion(trees.coordinates);
    data.reset_rows(rows);
    rows.stiffness[0] = stiffness;
    data.deformation[0] = -1e-3;
    bool thrown = false;
    try {
      dashpot::Team team(1);
      const std::vector<char> in_time(trees.tree.size(), 0);
      dashpot::MicrostepLoop(1).run(rows, trees, {island}, in_time, 0.1, 16e-4, data, team);
    } catch (const std::runtime_error&) {
      thrown = true;
    }
    check(thrown == std::isnan(stiffness), "forces that are no numbers are an error");
  }
}

}  // namespace

int main() {
  check_forces_that_are_no_numbers();
  return exit_status();
}
