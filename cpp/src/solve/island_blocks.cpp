#include "island_blocks.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <new>
#include <type_traits>

namespace dashpot {

namespace {

// Most slices, each of which costs every tree some additions, and groups from which on there are as
// many: a slice's share in a sweep takes several times as long as to hand it to a thread.
constexpr int kMostSlices = 4;
constexpr int kGroupsOfTwoSlices = 128, kGroupsOfFourSlices = 2048;

int slices_of(const Island& island) {
  const int groups = island.group_count();
  return groups >= kGroupsOfFourSlices ? kMostSlices : groups >= kGroupsOfTwoSlices ? 2 : 1;
}

// Fills one lane of a block from a group of rows.
struct LanePacker {
  const Rows& rows;
  const RowData& data;
  double h = 0.0;
  double recovery_speed = 0.0;
  double* sparse_values = nullptr;
  int* sparse_starts = nullptr;

  void pack_jacobian(const RowGroup& c, int lane, int /*values*/, PairLanes& j) const {
    const PairGeometry& pair = rows.pair[c.pair];
    for (int i = 0; i < 9; ++i) j.frame[i][lane] = pair.frame[i];
    for (int side = 0; side < 2; ++side) {
      for (int i = 0; i < 3; ++i) j.arm[side][i][lane] = pair.arm[side][i];
      j.body[side][lane] = pair.begin[side] > 0 ? pair.begin[side] : kBodyCoordinates * lane;
    }
  }

  void pack_jacobian(const RowGroup& c, int lane, int /*values*/, JointLanes& j) const {
    j.value[lane] = rows.value[c.value];
    j.column[lane] = rows.column[c.column];
  }

  void pack_jacobian(const RowGroup& c, int lane, int values, SparseLanes& j) const {
    pack_sparse(rows.value.data() + c.value, rows.column.data() + c.column, c.dim, c.width(),
                sparse_values + values, sparse_starts + values / kLanes, lane, j);
    spare_sparse(sparse_values, lane, j);
  }

  template <int Dim>
  void pack_rows(const RowGroup& c, int index, int lane, RowLanes<Dim>& law) const {
    for (int i = 0; i < Dim; ++i) {
      law.stiffness[i][lane] = rows.stiffness[c.row + i];
      law.damping[i][lane] = rows.damping[c.row + i];
      law.inverse_mass[i][lane] = rows.inverse_mass[c.row + i];
      law.deformation[i][lane] = data.deformation[c.row + i];
    }
    law.bearable[lane] = bearable_of(rows, data, c, recovery_speed);
    law.recovery_speed[lane] = recovery_speed_of(rows, data, index, recovery_speed);
    law.unstressed[lane] = data.unstressed[index];
    law.sticking[lane] = -1;
  }

  double relaxation(int row) const {
    const double k = rows.stiffness[row], d = rows.damping[row];
    return d > 0.0 ? std::exp(-k * h / d) : 0.0;
  }

  template <int Dim>
  void pack_law(const RowGroup& c, int index, int lane, ContactLanes<Dim>& law) const {
    law.loaded_friction[lane] = c.loaded_friction;
    law.inverse_friction_load[lane] = 1.0 / c.friction_load;
    law.load_dependent = law.load_dependent || c.loaded_friction < 1.0;
    law.ahead[lane] = c.ahead;
    law.drift[lane] = data.drift[index];
    for (int i = 0; i < std::min(Dim, 3); ++i) {
      law.turning[i][lane] = c.turning[i];
      law.turns = law.turns || c.turning[i] != 0.0;
    }
    for (int i = 1; i < Dim; ++i) {
      const double mu = rows.friction[c.row + i];
      if (mu > 0.0) {
        law.inverse_friction[i - 1][lane] = 1.0 / mu;
        law.relaxation[i - 1].relaxation[lane] = relaxation(c.row + i);
      } else {
        law.stiffness[i][lane] = law.damping[i][lane] = 0.0;
      }
    }
  }

  void pack_law(const RowGroup& c, int, int lane, SpringLanes& law) const {
    law.relaxation.relaxation[lane] = relaxation(c.row);
    law.limit[lane] =
        c.kind == RowKind::kSlider ? rows.friction[c.row] : std::numeric_limits<double>::infinity();
  }

  template <typename Jacobian, typename Law>
  void pack(const BlockGroups& groups, Block<Jacobian, Law>& block) const {
    new (&block) Block<Jacobian, Law>{};
    // Lanes to spare are open contacts far away.
    block.law.deformation[0] = all_lanes(1.0);
    for (int lane = 0; lane < groups.count; ++lane) {
      const int index = groups.group[lane];
      const RowGroup& c = rows.group[index];
      pack_jacobian(c, lane, groups.values[lane], block.jacobian);
      pack_rows(c, index, lane, block.law);
      pack_law(c, index, lane, block.law);
    }
  }
};

template <typename Law>
void unpack_lane(const Rows& rows, int index, int lane, const Law& law, RowData& data,
                 IslandWork& slice) {
  const RowGroup& c = rows.group[index];
  for (int i = 0; i < c.dim; ++i) {
    const int row = c.row + i;
    const bool frictionless = c.kind == RowKind::kContact && i > 0 && rows.friction[row] == 0.0;
    data.deformation[row] = frictionless ? 0.0 : law.deformation[i][lane];
    data.rate[row] = law.rate[i][lane];
    data.total_impulse[row] = law.total_impulse[i][lane];
  }
  if constexpr (std::is_same_v<Law, SpringLanes>) {
    data.force_moment[index] = law.force_moment[lane];
    data.touched[index] = law.touched[lane] != 0;
  } else {
    data.touched[index] = law.total_impulse[0][lane] > 0.0;
    double& of_surfaces = data.acceleration_work[index] = 0.0;
    for (int i = 0; i < std::min(c.dim, 3); ++i) {
      const double work = c.surface_acceleration[i] * law.lever[i][lane];
      share(slice.work, c, i) += work;  // it is a motion, unlike a turn
      of_surfaces += work;
    }
    data.turning_work[index] = law.turning_work[lane] - of_surfaces;
  }
  data.unstressed[index] = law.unstressed[lane];
  data.sticking[index] = law.sticking[lane] != 0;
  share(slice.work, c, 0) += law.work[0][lane];
  if (c.dim > 1) share(slice.work, c, 1) += law.work[1][lane];
  share(slice.recovery_input, c, 0) += law.recovery_input[lane];
}

}  // namespace

bool IslandBlocks::has_slices(const Island& island) { return slices_of(island) > 1; }

// Groups into the lists of their kinds, and sparse rows to their values.
void IslandBlocks::sort(const Rows& rows, const Island& island) {
  std::apply([](auto&... list) { (list.groups.clear(), ...); }, blocks_);
  int largest = 0;
  for (int index : island.group)
    if (const RowGroup& c = rows.group[index]; c.pair < 0)
      largest = std::max(largest, sparse_size(c.dim, c.width()));
  int values = largest;
  const auto append = [&](auto& list, int index) {
    if (list.groups.empty() || list.groups.back().count == kLanes) list.groups.emplace_back();
    BlockGroups& groups = list.groups.back();
    groups.values[groups.count] = values;
    groups.group[groups.count++] = index;
  };
  const auto append_contact = [&](auto jacobian, int index, int dim) {
    using Jacobian = decltype(jacobian);
    switch (dim) {
      case 1:
        return append(std::get<Blocks<Jacobian, ContactLanes<1>>>(blocks_), index);
      case 3:
        return append(std::get<Blocks<Jacobian, ContactLanes<3>>>(blocks_), index);
      case 4:
        return append(std::get<Blocks<Jacobian, ContactLanes<4>>>(blocks_), index);
      default:
        return append(std::get<Blocks<Jacobian, ContactLanes<6>>>(blocks_), index);
    }
  };
  for (int index : island.group) {
    const RowGroup& c = rows.group[index];
    const bool of_joint = c.pair < 0 && c.dim == 1 && c.width() == 1;
    if (!c.is_unilateral() && of_joint)
      append(std::get<Blocks<JointLanes, SpringLanes>>(blocks_), index);
    else if (!c.is_unilateral())
      append(std::get<Blocks<SparseLanes, SpringLanes>>(blocks_), index);
    else if (of_joint)
      append(std::get<Blocks<JointLanes, ContactLanes<1>>>(blocks_), index);
    else if (c.pair >= 0)
      append_contact(PairLanes{}, index, c.dim);
    else
      append_contact(SparseLanes{}, index, c.dim);
    if (c.pair < 0 && !of_joint) values += sparse_size(c.dim, c.width());
  }
  sparse_values_.assign(values, 0.0);
  sparse_starts_.resize(values / kLanes);
  // Blocks of islands before that were larger stay: to make them again would take time.
  const auto make_room = [](auto& list) {
    list.count = static_cast<int>(list.groups.size());
    if (list.block.size() < list.groups.size()) list.block.resize(list.groups.size());
  };
  std::apply([&](auto&... list) { (make_room(list), ...); }, blocks_);
}

void IslandBlocks::find_slices_of_trees(const Rows& rows, int tree_count) {
  of_tree_.assign(tree_count, 0);
  const auto visit = [&](const auto& list) {
    for (int slice = 0; slice < slices_; ++slice)
      for (int i = begin(list, slice); i < begin(list, slice + 1); ++i)
        for (int lane = 0; lane < list.groups[i].count; ++lane)
          for (int tree : rows.group[list.groups[i].group[lane]].tree)
            if (tree >= 0) of_tree_[tree] |= 1u << slice;
  };
  std::apply([&](const auto&... list) { (visit(list), ...); }, blocks_);
}

void IslandBlocks::find_ranges() {
  ranges_.resize(slices_);
  const auto find = [&](auto& list, auto& range, int slice) {
    range = {list.block.data() + begin(list, slice), list.block.data() + begin(list, slice + 1)};
  };
  for (int slice = 0; slice < slices_; ++slice)
    std::apply(
        [&](auto&... list) {
          std::apply([&](auto&... range) { (find(list, range, slice), ...); }, ranges_[slice]);
        },
        blocks_);
}

void IslandBlocks::pack(const Rows& rows, const Trees& trees, const Island& island, double h,
                        double recovery_speed, const RowData& data, Team& team) {
  sort(rows, island);
  slices_ = slices_of(island);
  if (slices_ > 1) find_slices_of_trees(rows, static_cast<int>(trees.tree.size()));
  find_ranges();
  const LanePacker packer{
      rows, data, h, recovery_speed, sparse_values_.data(), sparse_starts_.data()};
  team.for_each(slices_, 1, [&](int slice) {
    const auto pack_list = [&](auto& list) {
      for (int i = begin(list, slice); i < begin(list, slice + 1); ++i)
        packer.pack(list.groups[i], list.block[i]);
    };
    std::apply([&](auto&... list) { (pack_list(list), ...); }, blocks_);
  });
}

IslandWork IslandBlocks::unpack(const Rows& rows, RowData& data, Team& team) const {
  std::array<IslandWork, kMostSlices> work;
  team.for_each(slices_, 1, [&](int slice) {
    const auto unpack_list = [&](const auto& list) {
      for (int i = begin(list, slice); i < begin(list, slice + 1); ++i)
        for (int lane = 0; lane < list.groups[i].count; ++lane)
          unpack_lane(rows, list.groups[i].group[lane], lane, list.block[i].law, data, work[slice]);
    };
    std::apply([&](const auto&... list) { (unpack_list(list), ...); }, blocks_);
  });
  for (int slice = 1; slice < slices_; ++slice) {
    work[0].work += work[slice].work;
    work[0].recovery_input += work[slice].recovery_input;
  }
  return work[0];
}

}  // namespace dashpot
