#include "dashpot/microstep.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <tuple>
#include <type_traits>

#include "dashpot/sweeps.hpp"

namespace dashpot {

namespace {

// Whether the spring of a frictionless row that recovers at `speed` is never compressed beyond what
// is bearable: x stays within sqrt((x - x_0)^2 + u^2 / kappa) of its equilibrium x_0 = b / kappa,
// kappa = k w, under the load b, and damping only brings it nearer.
bool stays_bearable(const Rows& rows, const RowGroup& c, double speed, double recovery_speed,
                    const RowData& data) {
  double rate = 0.0, load = 0.0;
  gather(rows, c, data.velocity.data(), &rate);
  gather(rows, c, data.smooth_acceleration.data(), &load);
  const double kappa = rows.stiffness[c.row] * rows.inverse_mass[c.row];
  const double balance = load / kappa;
  const double fastest = std::max(std::abs(rate), std::abs(rate - speed));
  const double amplitude =
      std::hypot(data.deformation[c.row] - balance, fastest / std::sqrt(kappa));
  return amplitude - balance <= bearable_compression(rows, c, recovery_speed);
}

// Whether an island is one frictionless row of trees without dampers, whose flow is closed form
// over any time, with overlap that recovers at one speed or not at all.
bool flows_alone(const Rows& rows, const Trees& trees, const Island& island, double recovery_speed,
                 const RowData& data) {
  for (int tree : island.tree)
    if (trees.tree[tree].damped) return false;
  const int index = *island.group.begin();
  const RowGroup& c = rows.group[index];
  const double time = island.microsteps * island.duration, offset = data.offset[index];
  const double speed = std::min(offset / recovery_over(time).time, recovery_speed);
  return island.group.begin() + 1 == island.group.end() && c.is_unilateral() && c.dim == 1 &&
         c.turning[0] == 0.0 &&
         (offset <= 0.0 || stays_bearable(rows, c, speed, recovery_speed, data));
}

using AllBlocks =
    std::tuple<Blocks<PairLanes, ContactLanes<1>>, Blocks<PairLanes, ContactLanes<3>>,
               Blocks<PairLanes, ContactLanes<4>>, Blocks<PairLanes, ContactLanes<6>>,
               Blocks<SparseLanes, ContactLanes<1>>, Blocks<SparseLanes, ContactLanes<3>>,
               Blocks<SparseLanes, ContactLanes<4>>, Blocks<SparseLanes, ContactLanes<6>>,
               Blocks<SparseLanes, SpringLanes>, Blocks<JointLanes, ContactLanes<1>>,
               Blocks<JointLanes, SpringLanes>>;

}  // namespace

struct MicrostepLoop::Impl {
  const Rows* rows = nullptr;
  const Trees* trees = nullptr;
  const Island* island = nullptr;
  RowData* data = nullptr;
  int count = 0;  // micro-steps
  double h = 0.0;
  double recovery_speed = 0.0;
  AllBlocks blocks;
  std::vector<Tree> island_trees;
  AlignedDoubles displacement, force, impulse, moment, acceleration;
  AlignedDoubles slowing, drag;
  AlignedDoubles sparse_values;  // what SparseLanes point to
  int packed_values = 0;

  void pack();
  void run_microsteps();
  void unpack();

  template <Sweep kSweep>
  void sweep_rows(const IslandMotion& motion) {
    std::apply([&](auto&... list) { (sweep_fastest<kSweep>(list.block, motion), ...); }, blocks);
  }
  template <Sweep kSweep>
  void sweep_trees(const IslandMotion& motion) {
    sweep_fastest<kSweep>(island_trees, motion);
  }

  template <typename Jacobian, typename Law>
  void append(Blocks<Jacobian, Law>& list, int index);
  void make_room_for_sparse_rows();
  void pack_jacobian(const RowGroup& c, int lane, PairLanes& j) const;
  void pack_jacobian(const RowGroup& c, int lane, JointLanes& j) const;
  void pack_jacobian(const RowGroup& c, int lane, SparseLanes& j);
  template <int Dim>
  void pack_rows(const RowGroup& c, int index, int lane, RowLanes<Dim>& law) const;
  double relaxation(int row) const;
  template <int Dim>
  void pack_law(const RowGroup& c, int lane, ContactLanes<Dim>& law) const;
  void pack_law(const RowGroup& c, int lane, SpringLanes& law) const;
};

void MicrostepLoop::Impl::pack_jacobian(const RowGroup& c, int lane, PairLanes& j) const {
  const PairGeometry& pair = rows->pair[c.pair];
  for (int i = 0; i < 9; ++i) j.frame[i][lane] = pair.frame[i];
  for (int side = 0; side < 2; ++side) {
    for (int i = 0; i < 3; ++i) j.arm[side][i][lane] = pair.arm[side][i];
    j.body[side][lane] = pair.begin[side] > 0 ? pair.begin[side] : kBodyCoordinates * lane;
  }
}

void MicrostepLoop::Impl::pack_jacobian(const RowGroup& c, int lane, JointLanes& j) const {
  j.value[lane] = rows->value[c.value];
  j.column[lane] = rows->column[c.column];
}

void MicrostepLoop::Impl::make_room_for_sparse_rows() {
  int size = 0, largest = 0;
  for (int index : island->group) {
    const RowGroup& c = rows->group[index];
    if (c.pair >= 0) continue;
    const int of_group = sparse_size(c.dim, c.width());
    size += of_group;
    largest = std::max(largest, of_group);
  }
  sparse_values.assign(largest + size, 0.0);
  packed_values = largest;  // zeros before, for lanes to spare
}

void MicrostepLoop::Impl::pack_jacobian(const RowGroup& c, int lane, SparseLanes& j) {
  pack_sparse(rows->value.data() + c.value, rows->column.data() + c.column, c.dim, c.width(),
              sparse_values.data() + packed_values, lane, j);
  spare_sparse(sparse_values.data(), lane, j);
  packed_values += sparse_size(c.dim, c.width());
}

template <int Dim>
void MicrostepLoop::Impl::pack_rows(const RowGroup& c, int index, int lane,
                                    RowLanes<Dim>& law) const {
  for (int i = 0; i < Dim; ++i) {
    law.stiffness[i][lane] = rows->stiffness[c.row + i];
    law.damping[i][lane] = rows->damping[c.row + i];
    law.inverse_mass[i][lane] = rows->inverse_mass[c.row + i];
    law.deformation[i][lane] = data->deformation[c.row + i];
  }
  law.bearable[lane] = bearable_compression(*rows, c, recovery_speed);
  law.recovery_speed[lane] = recovery_speed_along(*rows, c, recovery_speed);
  law.offset[lane] = data->offset[index];
  law.sticking[lane] = -1;
}

double MicrostepLoop::Impl::relaxation(int row) const {
  const double k = rows->stiffness[row], d = rows->damping[row];
  return d > 0.0 ? std::exp(-k * h / d) : 0.0;
}

template <int Dim>
void MicrostepLoop::Impl::pack_law(const RowGroup& c, int lane, ContactLanes<Dim>& law) const {
  law.loaded_friction[lane] = c.loaded_friction;
  law.inverse_friction_load[lane] = 1.0 / c.friction_load;
  law.load_dependent = law.load_dependent || c.loaded_friction < 1.0;
  for (int i = 0; i < std::min(Dim, 3); ++i) {
    law.turning[i][lane] = c.turning[i];
    law.turns = law.turns || c.turning[i] != 0.0;
  }
  for (int i = 1; i < Dim; ++i) {
    const double mu = rows->friction[c.row + i];
    if (mu > 0.0) {
      law.inverse_friction[i - 1][lane] = 1.0 / mu;
      law.relaxation[i - 1].relaxation[lane] = relaxation(c.row + i);
    } else {
      law.stiffness[i][lane] = law.damping[i][lane] = 0.0;
    }
  }
}

void MicrostepLoop::Impl::pack_law(const RowGroup& c, int lane, SpringLanes& law) const {
  law.relaxation.relaxation[lane] = relaxation(c.row);
  law.limit[lane] =
      c.kind == RowKind::kSlider ? rows->friction[c.row] : std::numeric_limits<double>::infinity();
}

template <typename Jacobian, typename Law>
void MicrostepLoop::Impl::append(Blocks<Jacobian, Law>& list, int index) {
  if (list.groups.empty() || list.groups.back().count == kLanes) {
    list.block.emplace_back();
    list.groups.emplace_back();
    // Lanes to spare are open contacts far away.
    list.block.back().law.deformation[0] = all_lanes(1.0);
  }
  const RowGroup& c = rows->group[index];
  BlockGroups& groups = list.groups.back();
  Block<Jacobian, Law>& block = list.block.back();
  pack_jacobian(c, groups.count, block.jacobian);
  pack_rows(c, index, groups.count, block.law);
  pack_law(c, groups.count, block.law);
  groups.group[groups.count++] = index;
}

void MicrostepLoop::Impl::pack() {
  std::apply([](auto&... list) { (list.clear(), ...); }, blocks);
  make_room_for_sparse_rows();
  // After every micro-step forces and impulses are zero again, but for those on the ground.
  for (auto* array : {&displacement, &force, &impulse, &moment, &acceleration, &slowing, &drag}) {
    array->resize(trees->coordinates, 0.0);
    std::fill_n(array->begin(), kGroundCoordinates, 0.0);
  }
  island_trees.clear();
  for (int index : island->tree) {
    const Tree& t = trees->tree[index];
    island_trees.push_back(t);
    for (auto* array : {&displacement, &moment, &data->braked})
      std::fill_n(array->begin() + t.begin, t.count, 0.0);
  }
  const auto append_contact = [&](auto jacobian, int index, int dim) {
    using Jacobian = decltype(jacobian);
    switch (dim) {
      case 1:
        return append(std::get<Blocks<Jacobian, ContactLanes<1>>>(blocks), index);
      case 3:
        return append(std::get<Blocks<Jacobian, ContactLanes<3>>>(blocks), index);
      case 4:
        return append(std::get<Blocks<Jacobian, ContactLanes<4>>>(blocks), index);
      default:
        return append(std::get<Blocks<Jacobian, ContactLanes<6>>>(blocks), index);
    }
  };
  for (int index : island->group) {
    const RowGroup& c = rows->group[index];
    const bool of_joint = c.pair < 0 && c.dim == 1 && c.width() == 1;
    if (!c.is_unilateral() && of_joint)
      append(std::get<Blocks<JointLanes, SpringLanes>>(blocks), index);
    else if (!c.is_unilateral())
      append(std::get<Blocks<SparseLanes, SpringLanes>>(blocks), index);
    else if (of_joint)
      append(std::get<Blocks<JointLanes, ContactLanes<1>>>(blocks), index);
    else if (c.pair >= 0)
      append_contact(PairLanes{}, index, c.dim);
    else
      append_contact(SparseLanes{}, index, c.dim);
  }
}

void MicrostepLoop::Impl::run_microsteps() {
  IslandMotion m;
  m.h = h;
  m.recovery = recovery_over(island->microsteps * island->duration);
  m.velocity = data->velocity.data();
  m.displacement = displacement.data();
  m.acceleration = acceleration.data();
  m.force = force.data();
  m.impulse = impulse.data();
  m.moment = moment.data();
  m.total_displacement = data->total_displacement.data();
  m.coordinate_impulse = data->coordinate_impulse.data();
  m.smooth_acceleration = data->smooth_acceleration.data();
  m.inverse = trees->inverse.data();
  m.start_motion = data->start_motion.data();
  m.added = data->added_acceleration.data();
  m.damping = trees->damping.data();
  m.cross_damping = trees->cross_damping.data();
  m.lag = h * count - trees->implicit_time;
  m.slowing = slowing.data();
  m.drag = drag.data();
  m.braked = data->braked.data();
  acceleration[kTurningCoordinate] = 1.0;
  double& turning = data->velocity[kTurningCoordinate];
  const double turning_at_start = turning;
  sweep_rows<Sweep::kPrepare>(m);
  const double middle = 0.5 * h * count;
  m.rate_time = -middle;
  for (int i = 0; i < count; ++i) {
    sweep_rows<Sweep::kPresentForces>(m);
    m.coupled_time = kCoupledShare * h;
    m.work_time = i * h + 0.5 * h - middle;
    m.rate_time = (i + 1) * h - middle;
    turning += h;
    sweep_trees<Sweep::kSmoothMotion>(m);
    sweep_rows<Sweep::kFlow>(m);
    sweep_trees<Sweep::kContactMotion>(m);
  }
  sweep_rows<Sweep::kRead>(m);
  sweep_trees<Sweep::kDisplacement>(m);
  const double time = h * count;
  displacement[kSurfaceCoordinate] = time;
  displacement[kTurningCoordinate] = time * (turning_at_start + 0.5 * time);
  sweep_rows<Sweep::kFollow>(m);
  turning = turning_at_start;
  // A force that is no number shows here alone: rows whose load it is apply none.
  for (const Tree& tree : island_trees)
    check_bounded(tree, acceleration.data(), std::numeric_limits<double>::max());
}

void MicrostepLoop::Impl::unpack() {
  const auto unpack_group = [&](int index, int lane, const auto& law) {
    const RowGroup& c = rows->group[index];
    for (int i = 0; i < c.dim; ++i) {
      const int row = c.row + i;
      const bool frictionless = c.kind == RowKind::kContact && i > 0 && rows->friction[row] == 0.0;
      data->deformation[row] = frictionless ? 0.0 : law.deformation[i][lane];
      data->rate[row] = law.rate[i][lane];
      data->total_impulse[row] = law.total_impulse[i][lane];
    }
    if constexpr (std::is_same_v<std::decay_t<decltype(law)>, SpringLanes>) {
      data->force_moment[index] = law.force_moment[lane];
      data->touched[index] = law.touched[lane] != 0;
    } else {
      data->touched[index] = law.total_impulse[0][lane] > 0.0;
      data->turning_work[index] = law.turning_work[lane];
    }
    data->offset[index] = law.offset[lane];
    data->sticking[index] = law.sticking[lane] != 0;
    share(data->work, c, 0) += law.work[0][lane];
    if (c.dim > 1) share(data->work, c, 1) += law.work[1][lane];
    share(data->recovery_input, c, 0) += law.recovery_input[lane];
  };
  const auto unpack_list = [&](const auto& list) {
    for (size_t i = 0; i < list.groups.size(); ++i)
      for (int lane = 0; lane < list.groups[i].count; ++lane)
        unpack_group(list.groups[i].group[lane], lane, list.block[i].law);
  };
  std::apply([&](const auto&... list) { (unpack_list(list), ...); }, blocks);
}

MicrostepLoop::MicrostepLoop() : impl_(std::make_unique<Impl>()) {}
MicrostepLoop::~MicrostepLoop() = default;
MicrostepLoop::MicrostepLoop(MicrostepLoop&&) noexcept = default;

void MicrostepLoop::run(const Rows& rows, const Trees& trees, const Island& island,
                        double recovery_speed, RowData& data) {
  impl_->rows = &rows;
  impl_->trees = &trees;
  impl_->island = &island;
  impl_->data = &data;
  // Its stiffness is that of the micro-steps planned.
  const bool at_once = flows_alone(rows, trees, island, recovery_speed, data);
  impl_->count = at_once ? 1 : island.microsteps;
  impl_->h = at_once ? island.microsteps * island.duration : island.duration;
  impl_->recovery_speed = recovery_speed;
  impl_->pack();
  impl_->run_microsteps();
  impl_->unpack();
}

}  // namespace dashpot
