#include "dashpot/microstep.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <tuple>

#include "dashpot/contact_lanes.hpp"

namespace dashpot {

namespace {

bool is_unilateral(const RowGroup& c) {
  return c.kind == RowKind::kContact || c.kind == RowKind::kUnilateral;
}

// The Jacobian of four contacts between free bodies.
struct PairLanes {
  Lanes frame[9], arm[2][3];
  int body[2][kLanes];  // coordinates; lanes to spare act on the ground
};

// The Jacobian of four groups of sparse rows; lanes to spare have none.
struct SparseLanes {
  const double* value[kLanes];
  const int* column[kLanes];
  int width[kLanes];
};

[[gnu::always_inline]] inline void cross(const Lanes* a, const Lanes* b, Lanes* out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

[[gnu::always_inline]] inline Lanes dot(const Lanes* a, const Lanes* b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Linear and angular coordinates of four bodies.
[[gnu::always_inline]] inline void load_bodies(const double* motion, const int* body,
                                               Lanes (&linear)[kLanes], Lanes (&angular)[kLanes]) {
  for (int lane = 0; lane < kLanes; ++lane) {
    linear[lane] = load_lanes(motion + body[lane]);
    angular[lane] = load_lanes(motion + body[lane] + 4);
  }
  transpose(linear);
  transpose(angular);
}

[[gnu::always_inline]] inline void add_to_bodies(Lanes (&linear)[kLanes], Lanes (&angular)[kLanes],
                                                 const int* body, double* force) {
  transpose(linear);
  transpose(angular);
  for (int lane = 0; lane < kLanes; ++lane) {
    double* at = force + body[lane];
    store_lanes(load_lanes(at) + linear[lane], at);
    store_lanes(load_lanes(at + 4) + angular[lane], at + 4);
  }
}

// out = J motion.
template <int Dim>
[[gnu::always_inline]] inline void gather(const PairLanes& j, const double* motion, Lanes* out) {
  Lanes v1[kLanes], w1[kLanes], v2[kLanes], w2[kLanes], at1[3], at2[3], relative[3];
  load_bodies(motion, j.body[0], v1, w1);
  load_bodies(motion, j.body[1], v2, w2);
  cross(w1, j.arm[0], at1);
  cross(w2, j.arm[1], at2);
  for (int i = 0; i < 3; ++i) relative[i] = (v2[i] + at2[i]) - (v1[i] + at1[i]);
  for (int i = 0; i < std::min(Dim, 3); ++i) out[i] = dot(j.frame + 3 * i, relative);
  if (Dim <= 3) return;
  for (int i = 0; i < 3; ++i) relative[i] = w2[i] - w1[i];
  for (int i = 3; i < Dim; ++i) out[i] = dot(j.frame + 3 * (i - 3), relative);
}

// force += J' impulse.
template <int Dim>
[[gnu::always_inline]] inline void scatter(const PairLanes& j, const Lanes* impulse,
                                           double* force) {
  Lanes linear[3] = {}, torque[3] = {};
  for (int i = 0; i < std::min(Dim, 3); ++i)
    for (int k = 0; k < 3; ++k) linear[k] += j.frame[3 * i + k] * impulse[i];
  for (int i = 3; i < Dim; ++i)
    for (int k = 0; k < 3; ++k) torque[k] += j.frame[3 * (i - 3) + k] * impulse[i];
  for (int side = 0; side < 2; ++side) {
    const double sign = side == 0 ? -1.0 : 1.0;
    Lanes moment[3], f[kLanes], t[kLanes];
    cross(j.arm[side], linear, moment);
    for (int k = 0; k < 3; ++k) {
      f[k] = sign * linear[k];
      t[k] = sign * (moment[k] + torque[k]);
    }
    f[3] = t[3] = Lanes{};
    add_to_bodies(f, t, j.body[side], force);
  }
}

template <int Dim>
[[gnu::always_inline]] inline void gather(const SparseLanes& j, const double* motion, Lanes* out) {
  for (int i = 0; i < Dim; ++i) out[i] = Lanes{};
  for (int lane = 0; lane < kLanes; ++lane) {
    const int width = j.width[lane];
    const double* value = j.value[lane];
    double sum[Dim] = {};
    for (int k = 0; k < width; ++k) {
      const double at = motion[j.column[lane][k]];
      for (int i = 0; i < Dim; ++i) sum[i] += value[i * width + k] * at;
    }
    for (int i = 0; i < Dim; ++i) out[i][lane] = sum[i];
  }
}

template <int Dim>
[[gnu::always_inline]] inline void scatter(const SparseLanes& j, const Lanes* impulse,
                                           double* force) {
  for (int lane = 0; lane < kLanes; ++lane) {
    const int width = j.width[lane];
    const double* value = j.value[lane];
    double factor[Dim];
    for (int i = 0; i < Dim; ++i) factor[i] = impulse[i][lane];
    for (int k = 0; k < width; ++k) {
      double sum = 0.0;
      for (int i = 0; i < Dim; ++i) sum += value[i * width + k] * factor[i];
      force[j.column[lane][k]] += sum;
    }
  }
}

// Four groups with the same kind of Jacobian and law.
template <typename Jacobian, typename Law>
struct Block {
  static constexpr int kDim = sizeof(Law::rate) / sizeof(Lanes);
  Jacobian jacobian{};
  Law law{};
};
struct BlockGroups {
  std::array<int, kLanes> group{};
  int count = 0;
};
template <typename Jacobian, typename Law>
struct Blocks {
  std::vector<Block<Jacobian, Law>> block;
  std::vector<BlockGroups> groups;  // of each block

  void clear() {
    block.clear();
    groups.clear();
  }
};
using AllBlocks =
    std::tuple<Blocks<PairLanes, ContactLanes<1>>, Blocks<PairLanes, ContactLanes<3>>,
               Blocks<PairLanes, ContactLanes<4>>, Blocks<PairLanes, ContactLanes<6>>,
               Blocks<SparseLanes, ContactLanes<1>>, Blocks<SparseLanes, ContactLanes<3>>,
               Blocks<SparseLanes, ContactLanes<4>>, Blocks<SparseLanes, ContactLanes<6>>,
               Blocks<SparseLanes, SpringLanes>>;

// The arrays of one island's micro-steps, per motion coordinate: what rows apply are forces,
// impulses and moments of the impulses; `acceleration` is the one with all present forces.
struct Motion {
  double h = 0.0;
  double recovery_speed = 0.0;
  double *velocity, *displacement, *acceleration;
  double *force, *impulse, *moment;
  double *total_displacement, *total_impulse;
  const double *smooth_acceleration, *inverse;
};

// A micro-step is four sweeps, over rows and trees in turn.
enum class Sweep {
  kPrepare,        // rows, before the first: what depends on parameters and h alone
  kPresentForces,  // rows: motion of the last micro-step, then the forces all rows have now
  kSmoothMotion,   // trees: acceleration with those forces; motion without the rows' impulses
  kFlow,           // rows: closed-form flow of every row under its load
  kContactMotion,  // trees: the motion that the impulses cause
  kRead            // rows, after the last micro-step: its motion
};

template <typename Jacobian, typename Law>
[[gnu::always_inline]] inline void sweep_one(Sweep sweep, Block<Jacobian, Law>& block,
                                             const Motion& m) {
  constexpr int kDim = Block<Jacobian, Law>::kDim;
  Law& law = block.law;
  if (sweep == Sweep::kPrepare) return prepare(law, m.h);
  if (sweep == Sweep::kFlow) {
    Lanes acceleration[kDim];
    gather<kDim>(block.jacobian, m.acceleration, acceleration);
    flow(law, acceleration, m.h);
    scatter<kDim>(block.jacobian, law.impulse, m.impulse);
    scatter<kDim>(block.jacobian, law.moment, m.moment);
    return;
  }
  Lanes rate[kDim], displacement[kDim];
  gather<kDim>(block.jacobian, m.velocity, rate);
  gather<kDim>(block.jacobian, m.displacement, displacement);
  read_motion(law, rate, displacement, m.h, m.recovery_speed);
  if (sweep == Sweep::kRead) return;
  find_present_force(law);
  scatter<kDim>(block.jacobian, law.force, m.force);
}

// out += inv(H) applied.
[[gnu::always_inline]] inline void respond(const Tree& t, const double* inverse,
                                           const double* applied, double* out) {
  const double* column = inverse + t.inverse;
  applied += t.begin;
  out += t.begin;
  if (t.free_body) {
    store_lanes(load_lanes(out) + load_lanes(column) * load_lanes(applied), out);
    Lanes sum = load_lanes(out + 4);
    for (int j = 0; j < 3; ++j) sum += load_lanes(column + 4 * (j + 1)) * applied[4 + j];
    store_lanes(sum, out + 4);
    return;
  }
  for (int j = 0; j < t.dof_count; ++j, column += t.count) {
    if (applied[j] == 0.0) continue;
    for (int i = 0; i < t.count; i += kLanes)
      store_lanes(load_lanes(out + i) + load_lanes(column + i) * applied[j], out + i);
  }
}

[[gnu::always_inline]] inline void add_lanes(const double* term, double* sum) {
  store_lanes(load_lanes(sum) + load_lanes(term), sum);
}

[[gnu::always_inline]] inline void sweep_one(Sweep sweep, const Tree& t, const Motion& m) {
  if (sweep == Sweep::kSmoothMotion) {
    for (int i = t.begin; i < t.begin + t.count; i += kLanes) {
      const Lanes a = load_lanes(m.smooth_acceleration + i), v = load_lanes(m.velocity + i);
      store_lanes(a, m.acceleration + i);
      store_lanes(m.h * (v + 0.5 * m.h * a), m.displacement + i);
      store_lanes(v + m.h * a, m.velocity + i);
    }
    respond(t, m.inverse, m.force, m.acceleration);
    return;
  }
  respond(t, m.inverse, m.impulse, m.velocity);
  respond(t, m.inverse, m.moment, m.displacement);
  for (int i = t.begin; i < t.begin + t.count; i += kLanes) {
    add_lanes(m.displacement + i, m.total_displacement + i);
    add_lanes(m.impulse + i, m.total_impulse + i);
    for (double* applied : {m.force, m.impulse, m.moment}) store_lanes(Lanes{}, applied + i);
  }
}

template <typename Item>
[[gnu::always_inline]] inline void sweep_all(Sweep sweep, Item* first, Item* last,
                                             const Motion& m) {
  for (Item* item = first; item != last; ++item) sweep_one(sweep, *item, m);
}

// The same for several instruction sets. Lanes do not mix and nothing is fused, so all give the
// same bits.
template <typename Item>
[[gnu::flatten]] void sweep_portable(Sweep sweep, Item* first, Item* last, const Motion& m) {
  sweep_all(sweep, first, last, m);
}
#if defined(__x86_64__)
template <typename Item>
[[gnu::flatten, gnu::target("avx2")]] void sweep_avx2(Sweep sweep, Item* first, Item* last,
                                                      const Motion& m) {
  sweep_all(sweep, first, last, m);
}
template <typename Item>
[[gnu::flatten, gnu::target("avx512f,avx512vl,avx512dq")]] void sweep_avx512(Sweep sweep,
                                                                             Item* first,
                                                                             Item* last,
                                                                             const Motion& m) {
  sweep_all(sweep, first, last, m);
}
enum class InstructionSet { kPortable, kAvx2, kAvx512 };
InstructionSet find_instruction_set() {
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
      __builtin_cpu_supports("avx512dq"))
    return InstructionSet::kAvx512;
  return __builtin_cpu_supports("avx2") ? InstructionSet::kAvx2 : InstructionSet::kPortable;
}
#endif

template <typename Item>
void sweep_fastest(Sweep sweep, std::vector<Item>& items, const Motion& m) {
  if (items.empty()) return;
  Item* const first = items.data();
  Item* const last = first + items.size();
#if defined(__x86_64__)
  static const InstructionSet instructions = find_instruction_set();
  if (instructions == InstructionSet::kAvx512) return sweep_avx512(sweep, first, last, m);
  if (instructions == InstructionSet::kAvx2) return sweep_avx2(sweep, first, last, m);
#endif
  sweep_portable(sweep, first, last, m);
}

}  // namespace

struct MicrostepLoop::Impl {
  const Rows* rows = nullptr;
  const Trees* trees = nullptr;
  const Island* island = nullptr;
  RowData* data = nullptr;
  double h = 0.0;
  double recovery_speed = 0.0;
  AllBlocks blocks;
  std::vector<Tree> island_trees;
  std::vector<double> displacement, force, impulse, moment, acceleration;

  void pack();
  void run_microsteps();
  void unpack();

  void sweep_rows(Sweep sweep, const Motion& motion) {
    std::apply([&](auto&... list) { (sweep_fastest(sweep, list.block, motion), ...); }, blocks);
  }
  void sweep_trees(Sweep sweep, const Motion& motion) {
    sweep_fastest(sweep, island_trees, motion);
  }

  template <typename Jacobian, typename Law>
  void append(Blocks<Jacobian, Law>& list, int index);
  void pack_jacobian(const RowGroup& c, int lane, PairLanes& j) const;
  void pack_jacobian(const RowGroup& c, int lane, SparseLanes& j) const;
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
    j.body[side][lane] = pair.begin[side];
  }
}

void MicrostepLoop::Impl::pack_jacobian(const RowGroup& c, int lane, SparseLanes& j) const {
  j.value[lane] = rows->value.data() + c.value;
  j.column[lane] = rows->column.data() + c.column;
  j.width[lane] = c.width();
}

template <int Dim>
void MicrostepLoop::Impl::pack_rows(const RowGroup& c, int index, int lane,
                                    RowLanes<Dim>& law) const {
  double load[kMaxRows];
  dashpot::gather(*rows, c, data->smooth_acceleration.data(), load);
  for (int i = 0; i < Dim; ++i) {
    law.stiffness[i][lane] = rows->stiffness[c.row + i];
    law.damping[i][lane] = rows->damping[c.row + i];
    law.inverse_mass[i][lane] = rows->inverse_mass[c.row + i];
    law.smooth_load[i][lane] = load[i];
    law.deformation[i][lane] = data->deformation[c.row + i];
  }
  const double w = std::max(rows->inverse_mass[c.row], rows->typical_inverse_mass[c.row]);
  law.recovers_within[lane] = recovery_speed * recovery_speed / (rows->stiffness[c.row] * w);
  law.offset[lane] = data->offset[index];
  law.sticking[lane] = -1;
}

double MicrostepLoop::Impl::relaxation(int row) const {
  const double k = rows->stiffness[row], d = rows->damping[row];
  return d > 0.0 ? std::exp(-k * h / d) : 0.0;
}

template <int Dim>
void MicrostepLoop::Impl::pack_law(const RowGroup& c, int lane, ContactLanes<Dim>& law) const {
  for (int i = 1; i < Dim; ++i) {
    const double mu = rows->friction[c.row + i];
    if (mu > 0.0) {
      law.inverse_friction[i - 1][lane] = 1.0 / mu;
      law.spring[i - 1].relaxation[lane] = relaxation(c.row + i);
    } else {
      law.stiffness[i][lane] = law.damping[i][lane] = 0.0;
    }
  }
}

void MicrostepLoop::Impl::pack_law(const RowGroup& c, int lane, SpringLanes& law) const {
  law.spring.relaxation[lane] = relaxation(c.row);
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
  // After every micro-step forces and impulses are zero again, but for those on the ground.
  for (auto* array : {&displacement, &force, &impulse, &moment, &acceleration}) {
    array->resize(trees->coordinates, 0.0);
    std::fill_n(array->begin(), kBodyCoordinates, 0.0);
  }
  island_trees.clear();
  for (int index : island->tree) {
    const Tree& t = trees->tree[index];
    island_trees.push_back(t);
    std::fill_n(displacement.begin() + t.begin, t.count, 0.0);
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
    if (!is_unilateral(c))
      append(std::get<Blocks<SparseLanes, SpringLanes>>(blocks), index);
    else if (c.pair >= 0)
      append_contact(PairLanes{}, index, c.dim);
    else
      append_contact(SparseLanes{}, index, c.dim);
  }
}

void MicrostepLoop::Impl::run_microsteps() {
  Motion m;
  m.h = h;
  m.recovery_speed = recovery_speed;
  m.velocity = data->velocity.data();
  m.displacement = displacement.data();
  m.acceleration = acceleration.data();
  m.force = force.data();
  m.impulse = impulse.data();
  m.moment = moment.data();
  m.total_displacement = data->total_displacement.data();
  m.total_impulse = data->coordinate_impulse.data();
  m.smooth_acceleration = data->smooth_acceleration.data();
  m.inverse = trees->inverse.data();
  sweep_rows(Sweep::kPrepare, m);
  for (int i = 0; i < island->microsteps; ++i) {
    sweep_rows(Sweep::kPresentForces, m);
    displacement[kSurfaceCoordinate] = h;  // of every micro-step; none before the first
    sweep_trees(Sweep::kSmoothMotion, m);
    sweep_rows(Sweep::kFlow, m);
    sweep_trees(Sweep::kContactMotion, m);
  }
  sweep_rows(Sweep::kRead, m);
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
    data->offset[index] = law.offset[lane];
    data->sticking[index] = law.sticking[lane] != 0;
    data->touched[index] = law.touched[lane] != 0;
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
  impl_->h = island.duration;
  impl_->recovery_speed = recovery_speed;
  impl_->pack();
  impl_->run_microsteps();
  impl_->unpack();
}

double& share(EnergyShares& shares, const RowGroup& c, int i) {
  if (c.kind != RowKind::kContact) return shares.constraint;
  return i == 0 ? shares.normal : shares.friction;
}

void RowData::reset_motion(int coordinates) {
  for (auto* array : {&velocity, &smooth_acceleration, &total_displacement, &coordinate_impulse})
    array->assign(coordinates, 0.0);
  velocity[kSurfaceCoordinate] = 1.0;
}

void RowData::reset_rows(const Rows& rows) {
  for (auto* array : {&deformation, &rate, &total_impulse})
    array->assign(rows.inverse_mass.size(), 0.0);
  offset.assign(rows.group.size(), 0.0);
  sticking.assign(rows.group.size(), 1);
  touched.assign(rows.group.size(), 0);
  work = recovery_input = EnergyShares{};
}

bool overlaps_semi_implicitly(const Rows& rows, const RowGroup& c, double gap,
                              const double* velocity, const double* acceleration, double time) {
  if (!is_unilateral(c) || gap <= 0.0) return false;
  double rate[kMaxRows], load[kMaxRows];
  gather(rows, c, velocity, rate);
  gather(rows, c, acceleration, load);
  return gap + time * (rate[0] + time * load[0]) <= 0.0;
}

bool stays_apart(const Rows& rows, const Island& island, double time, const RowData& data) {
  for (int index : island.group) {
    const RowGroup& c = rows.group[index];
    if (!is_unilateral(c) || data.deformation[c.row] <= 0.0) return false;
  }
  for (int index : island.group) {
    const RowGroup& c = rows.group[index];
    const double gap = data.deformation[c.row];
    double rate[kMaxRows], load[kMaxRows];
    gather(rows, c, data.velocity.data(), rate);
    gather(rows, c, data.smooth_acceleration.data(), load);
    // The parabola's least value within the time: at an end, or where it turns.
    const double end = gap + time * (rate[0] + 0.5 * load[0] * time);
    const bool turns = rate[0] < 0.0 && rate[0] + load[0] * time > 0.0;
    const double least = turns ? gap - 0.5 * rate[0] * rate[0] / load[0] : end;
    if (least <= 0.0) return false;
    if (gap + time * (rate[0] + time * load[0]) <= 0.0) return false;
  }
  return true;
}

EnergyShares elastic_energy(const Rows& rows, const RowData& data) {
  EnergyShares energy;
  for (const RowGroup& c : rows.group) {
    if (is_unilateral(c) && data.deformation[c.row] >= 0.0) continue;
    for (int i = 0; i < c.dim; ++i) {
      const double x = data.deformation[c.row + i];
      share(energy, c, i) += 0.5 * rows.stiffness[c.row + i] * x * x;
    }
  }
  return energy;
}

}  // namespace dashpot
