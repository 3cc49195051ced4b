// The sweeps of sweeps.hpp, compiled for the instruction set of the file that includes this.
//
// All functions are static: what other files compile for other instruction sets is not theirs.

#pragma once

#include <type_traits>

#include "dashpot/lanes/lane_blocks.hpp"
#include "dashpot/lanes/prefetch.hpp"
#include "dashpot/solve/lane_flow.hpp"
#include "dashpot/solve/sweeps.hpp"

namespace dashpot {

template <Sweep kSweep, typename Jacobian, typename Law>
[[gnu::always_inline]] static inline void sweep_one(Block<Jacobian, Law>& block,
                                                    const IslandMotion& m) {
  constexpr int kDim = Block<Jacobian, Law>::kDim;
  Law& law = block.law;
  if constexpr (kSweep == Sweep::kPrepare) {
    prepare(law, m.h);
  } else if constexpr (kSweep == Sweep::kFlow) {
    Lanes acceleration[kDim], moment[kDim];
    gather<kDim>(block.jacobian, m.acceleration, acceleration);
    flow(law, acceleration, m.h, moment);
    if constexpr (std::is_same_v<Law, SpringLanes>)
      law.force_moment += law.impulse[0] * m.velocity[kTurningCoordinate] - moment[0];
    scatter<kDim>(block.jacobian, law.impulse, m.impulse);
  } else if constexpr (kSweep == Sweep::kFollow) {
    Lanes displacement[kDim];
    gather<kDim>(block.jacobian, m.displacement, displacement);
    if constexpr (!std::is_same_v<Law, SpringLanes>)
      if (law.turns) turn_displacement(law, m.rate_time, displacement);
    follow_bodies(law, displacement);
  } else {
    Lanes rate[kDim];
    gather<kDim>(block.jacobian, m.velocity, rate);
    if constexpr (!std::is_same_v<Law, SpringLanes>)
      if (law.turns) turn_rows(law, m.rate_time, m.work_time, rate);
    read_motion(law, rate, m.h, m.coupled_time, m.recovery);
    if constexpr (kSweep == Sweep::kRead) {
      Lanes load[kDim];
      gather<kDim>(block.jacobian, m.smooth_acceleration, load);
      account_load(law, load, m.h);
      scatter_two<kDim>(block.jacobian, law.total_impulse, law.total_moment, m.coordinate_impulse,
                        m.moment);
    } else {
      static_assert(kSweep == Sweep::kPresentForces);
      find_present_force(law);
      scatter<kDim>(block.jacobian, law.force, m.force);
    }
  }
}

// out += inv(H) applied.
[[gnu::always_inline]] static inline void respond(const Tree& t, const double* inverse,
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
  for_each_block(
      t.count, [&](int first, auto width) __attribute__((always_inline)) {
        Lanes sum[width()];
        load_block(out + first, sum);
        for (int j = 0; j < t.dof_count; ++j)
          if (applied[j] != 0.0) add_scaled(column + j * t.count + first, applied[j], sum);
        store_block(sum, out + first);
      });
}

[[gnu::always_inline]] static inline void respond(const IslandTree& of, const double* inverse,
                                                  const double* applied, double* out) {
  const int begin = of.tree.begin;
  if (of.tree.sparse)
    add_response(*of.trees, of.index, applied + begin, out + begin);
  else
    respond(of.tree, inverse, applied, out);
}

[[gnu::always_inline]] static inline void add_lanes(const double* term, double* sum) {
  store_lanes(load_lanes(sum) + load_lanes(term), sum);
}

// Finds the drag of a tree.
[[gnu::always_inline]] static inline void find_drag(const Tree& t, const IslandMotion& m) {
  for (int i = t.begin; i < t.begin + t.count; i += kLanes) {
    const Lanes slowing = (m.step - t.implicit_time) *
                              (load_lanes(m.smooth_acceleration + i) - load_lanes(m.added + i)) -
                          load_lanes(m.velocity + i) + load_lanes(m.start_motion + i);
    store_lanes(slowing, m.slowing + i);
    store_lanes(load_lanes(m.damping + i) * slowing, m.drag + i);
  }
  if (t.cross_damped) respond(t, m.cross_damping, m.slowing, m.drag);
}

// Adds a force and its moment to those of the rows.
[[gnu::always_inline]] static inline void add_to_rows(const Tree& t, const IslandMotion& m,
                                                      const double* force) {
  for (int i = t.begin; i < t.begin + t.count; i += kLanes) {
    const Lanes of = load_lanes(force + i);
    store_lanes(load_lanes(m.force + i) + of, m.force + i);
    store_lanes(load_lanes(m.moment + i) + 0.5 * m.h * m.h * of, m.moment + i);
  }
}

// Adds the impulse of a tree's drag over the micro-step.
[[gnu::always_inline]] static inline void add_impulse_of_drag(const Tree& t,
                                                              const IslandMotion& m) {
  for (int i = t.begin; i < t.begin + t.count; i += kLanes)
    store_lanes(load_lanes(m.impulse + i) + m.h * load_lanes(m.drag + i), m.impulse + i);
}

// Books what the drag takes by the velocity at one end of the micro-step.
[[gnu::always_inline]] static inline void account_drag(const Tree& t, const IslandMotion& m) {
  for (int i = t.begin; i < t.begin + t.count; i += kLanes)
    store_lanes(
        load_lanes(m.braked + i) - 0.5 * m.h * load_lanes(m.drag + i) * load_lanes(m.velocity + i),
        m.braked + i);
}

// Goes half of the way, and finds the pull of a tree's springs there.
[[gnu::always_inline]] static inline void find_pull(const Tree& t, const IslandMotion& m) {
  for (int i = t.begin; i < t.begin + t.count; i += kLanes) {
    const Lanes middle = load_lanes(m.way + i) + 0.5 * m.h * load_lanes(m.velocity + i);
    store_lanes(middle, m.way + i);
    store_lanes(-load_lanes(m.stiffness + i) * middle, m.pull + i);
  }
}

// Adds the drag and the pull of an elastic tree to what has been found of both.
[[gnu::always_inline]] static inline void add_elastic(const IslandTree& of, const IslandMotion& m) {
  const int to_coordinate = of.tree.begin - of.tree.dof_begin;
  for (const ImplicitEntry& entry : of.implicit) {
    const int i = entry.row + to_coordinate, j = entry.column + to_coordinate;
    const double stiffness = entry.stiffness, damping = entry.damping + m.step * stiffness;
    m.drag[i] += damping * m.slowing[j];
    m.pull[i] -= stiffness * m.way[j];
    if (i == j) continue;
    m.drag[j] += damping * m.slowing[i];
    m.pull[j] -= stiffness * m.way[i];
  }
}

// Adds the impulse of its springs over the micro-step.
[[gnu::always_inline]] static inline void add_impulse_of_springs(const Tree& t,
                                                                 const IslandMotion& m) {
  for (int i = t.begin; i < t.begin + t.count; i += kLanes) {
    const Lanes impulse = m.h * load_lanes(m.pull + i);
    store_lanes(load_lanes(m.impulse + i) + impulse, m.impulse + i);
    store_lanes(load_lanes(m.pulled + i) + impulse, m.pulled + i);
  }
}

// Goes the other half of the way, by the velocity at the end of the micro-step.
[[gnu::always_inline]] static inline void go_on(const Tree& t, const IslandMotion& m) {
  for (int i = t.begin; i < t.begin + t.count; i += kLanes)
    store_lanes(load_lanes(m.way + i) + 0.5 * m.h * load_lanes(m.velocity + i), m.way + i);
}

[[gnu::always_inline]] static inline void set_to_zero(const Tree& t, double* applied) {
  for (int i = t.begin; i < t.begin + t.count; i += kLanes) store_lanes(Lanes{}, applied + i);
}

// Adds what other slices have applied, in their order, and leaves zeros.
[[gnu::always_inline]] static inline void take_slices(const IslandTree& of, int slice_size,
                                                      double* of_slices, double* sum) {
  const int begin = of.tree.begin, end = begin + of.tree.count;
  for (unsigned left = of.slices; left != 0; left &= left - 1) {
    double* const applied = of_slices + __builtin_ctz(left) * slice_size;
    for (int i = begin; i < end; i += kLanes) {
      add_lanes(applied + i, sum + i);
      store_lanes(Lanes{}, applied + i);
    }
  }
}

template <Sweep kSweep>
[[gnu::always_inline]] static inline void sweep_one(const IslandTree& of, const IslandMotion& m) {
  const Tree t = of.tree;
  if constexpr (kSweep == Sweep::kSmoothMotion) {
    if (of.slices) take_slices(of, m.slice_size, m.force_of_slices, m.force);
    if (t.damped) find_drag(t, m);
    if (t.sprung) find_pull(t, m);
    if (t.elastic) add_elastic(of, m);
    if (t.damped) account_drag(t, m);
    if (t.damped) add_to_rows(t, m, m.drag);
    if (t.sprung) add_to_rows(t, m, m.pull);
    for (int i = t.begin; i < t.begin + t.count; i += kLanes) {
      const Lanes a = load_lanes(m.smooth_acceleration + i), v = load_lanes(m.velocity + i);
      store_lanes(a, m.acceleration + i);
      const Lanes displacement = load_lanes(m.displacement + i);
      store_lanes(displacement + m.h * (v + 0.5 * m.h * a), m.displacement + i);
      store_lanes(v + m.h * a, m.velocity + i);
    }
    respond(of, m.inverse, m.force, m.acceleration);
  } else if constexpr (kSweep == Sweep::kDisplacement) {
    if (of.slices) {
      take_slices(of, m.slice_size, m.force_of_slices, m.coordinate_impulse);
      take_slices(of, m.slice_size, m.impulse_of_slices, m.moment);
    }
    respond(of, m.inverse, m.moment, m.displacement);
    for (int i = t.begin; i < t.begin + t.count; i += kLanes)
      add_lanes(m.displacement + i, m.total_displacement + i);
  } else {
    static_assert(kSweep == Sweep::kContactMotion);
    if (of.slices) take_slices(of, m.slice_size, m.impulse_of_slices, m.impulse);
    if (t.damped) add_impulse_of_drag(t, m);
    if (t.sprung) add_impulse_of_springs(t, m);
    respond(of, m.inverse, m.impulse, m.velocity);
    if (t.damped) account_drag(t, m);
    if (t.sprung) go_on(t, m);
    set_to_zero(t, m.force);
    set_to_zero(t, m.impulse);
  }
}

static constexpr int kBlocksAhead = 2;
// Asks ahead for the motion of the bodies of a block that comes soon.
template <Sweep kSweep, typename Law>
[[gnu::always_inline]] static inline void prefetch_motion(const Block<PairLanes, Law>& block,
                                                          const IslandMotion& m) {
  if constexpr (kSweep == Sweep::kFlow || kSweep == Sweep::kPresentForces) {
    constexpr bool kFlows = kSweep == Sweep::kFlow;
    for (const auto& side : block.jacobian.body)
      for (int body : side) {
        prefetch((kFlows ? m.acceleration : m.velocity) + body, sizeof(double));
        prefetch((kFlows ? m.impulse : m.force) + body, sizeof(double));
      }
  }
}
template <Sweep kSweep, typename Item>
[[gnu::always_inline]] static inline void prefetch_motion(const Item&, const IslandMotion&) {}

// A function of its own for every kind of item, for the compiler's sake.
template <Sweep kSweep, typename Item>
[[gnu::flatten, gnu::noinline]] static void sweep_all(Item* first, Item* last,
                                                      const IslandMotion& motion) {
  const IslandMotion m = motion;  // a copy, which no store to an array may change
  for (Item* item = first; item != last; ++item) {
    if (item + kBlocksAhead < last) prefetch_motion<kSweep>(item[kBlocksAhead], m);
    sweep_one<kSweep>(*item, m);
  }
}

template <Sweep kSweep>
static void sweep_kinds(const BlockRanges& blocks, const IslandMotion& m) {
  const auto sweep_kind = [&](const auto& kind) __attribute__((always_inline)) {
    if (kind.first != kind.last) sweep_all<kSweep>(kind.first, kind.last, m);
  };
  std::apply(
      [&](const auto&... kind) __attribute__((always_inline)) { (sweep_kind(kind), ...); }, blocks);
}

[[gnu::flatten]] static void sweep_rows(Sweep sweep, const BlockRanges& blocks,
                                        const IslandMotion& m) {
  switch (sweep) {
    case Sweep::kPrepare:
      return sweep_kinds<Sweep::kPrepare>(blocks, m);
    case Sweep::kPresentForces:
      return sweep_kinds<Sweep::kPresentForces>(blocks, m);
    case Sweep::kFlow:
      return sweep_kinds<Sweep::kFlow>(blocks, m);
    case Sweep::kRead:
      return sweep_kinds<Sweep::kRead>(blocks, m);
    case Sweep::kFollow:
      return sweep_kinds<Sweep::kFollow>(blocks, m);
    default:
      return;  // over trees
  }
}

static void sweep_trees(Sweep sweep, const IslandTree* first, const IslandTree* last,
                        const IslandMotion& m) {
  switch (sweep) {
    case Sweep::kSmoothMotion:
      return sweep_all<Sweep::kSmoothMotion>(first, last, m);
    case Sweep::kContactMotion:
      return sweep_all<Sweep::kContactMotion>(first, last, m);
    case Sweep::kDisplacement:
      return sweep_all<Sweep::kDisplacement>(first, last, m);
    default:
      return;  // over rows
  }
}

static constexpr SweepFunctions kSweeps{sweep_rows, sweep_trees};

}  // namespace dashpot
