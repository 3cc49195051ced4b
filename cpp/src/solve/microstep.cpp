#include "dashpot/solve/microstep.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dashpot/solve/lane_flow.hpp"
#include "island_blocks.hpp"

namespace dashpot {

namespace {

// Whether the spring of a frictionless row that recovers at `speed` is never compressed beyond what
// is bearable: x stays within sqrt((x - x_0)^2 + u^2 / kappa) of its equilibrium x_0 = b / kappa,
// kappa = k w, under the load b, and damping only brings it nearer.
bool stays_bearable(const Rows& rows, const RowGroup& c, double speed, double recovery_speed,
                    const RowData& data) {
  const double rate = first_rate(rows, c, data.velocity);
  const double load = first_rate(rows, c, data.smooth_acceleration);
  const double kappa = rows.stiffness[c.row] * rows.inverse_mass[c.row];
  const double balance = load / kappa;
  const double fastest = std::max(std::abs(rate), std::abs(rate - speed));
  const double amplitude =
      std::hypot(data.deformation[c.row] - balance, fastest / std::sqrt(kappa));
  return amplitude - balance <= bearable_of(rows, data, c, recovery_speed);
}

// Whether an island is one frictionless row of trees without dampers or springs, whose flow is
// closed form over any time, with overlap that recovers at one speed or not at all.
bool flows_alone(const Rows& rows, const Trees& trees, const Island& island, double recovery_speed,
                 const RowData& data) {
  if (island.group_count() != 1) return false;
  for (int tree : island.tree)
    if (trees.tree[tree].damped || trees.tree[tree].sprung) return false;
  const int index = *island.group.begin();
  const RowGroup& c = rows.group[index];
  const double time = island.microsteps * island.duration, offset = data.unstressed[index];
  const double speed = std::min(offset / recovery_over(time).time,
                                recovery_speed_of(rows, data, index, recovery_speed));
  return c.is_unilateral() && c.dim == 1 && c.turning[0] == 0.0 &&
         (offset <= 0.0 || speed == 0.0 || stays_bearable(rows, c, speed, recovery_speed, data));
}

// Moves a tree over `time` (s) by its smooth motion alone, without dampers or springs.
void coast(const Tree& t, double time, RowData& data) {
  for (int i = t.begin; i < t.begin + t.count; ++i) {
    const double acceleration = data.smooth_acceleration[i];
    data.total_displacement[i] += time * (data.velocity[i] + 0.5 * time * acceleration);
    data.velocity[i] += time * acceleration;
  }
}

// What a thread takes at once: trees of a large island, or groups of small ones.
constexpr int kTreesAtOnce = 32, kGroupsAtOnce = 16;

// Whether an island needs no micro-steps, flows in closed form over all of them, or takes them.
enum class Course : char { kApart, kAtOnce, kInMicrosteps };

// An island, or small ones in a row that flow alike: their groups fill lanes together.
struct Batch {
  Island island;
  Course course;

  bool may_take(const Island& next, Course course_of_next) const {
    return course == course_of_next && island.microsteps == next.microsteps &&
           island.duration == next.duration && island.group.last == next.group.first &&
           island.tree.last == next.tree.first &&
           island.group_count() + next.group_count() <= kGroupsAtOnce;
  }
};

// The micro-steps of one island at a time. Has arrays of its own of all that rows apply, also to
// the ground, and of what the ground does meanwhile.
struct IslandLoop {
  // Returns the energies that go to RowData::work and RowData::recovery_input.
  IslandWork run(const Rows& rows, const Trees& trees, const Island& island, Course course,
                 double recovery_speed, RowData& data, Team& team);

  IslandBlocks blocks;
  const SweepFunctions& sweeps = fastest_sweeps();
  std::vector<IslandTree> island_trees;
  AlignedDoubles velocity, displacement, force, impulse, moment, acceleration;
  AlignedDoubles coordinate_impulse, slowing, drag, way, pull;
  AlignedDoubles force_of_slices, impulse_of_slices;

  void start(const Trees& trees, const Island& island, RowData& data);
  IslandMotion motion(const Trees& trees, RowData& data);
  void run_microsteps(IslandMotion& motion, int count, Team& team);
  void finish(RowData& data) const;

  void sweep_rows(Sweep sweep, const IslandMotion& motion, Team& team) {
    if (blocks.slices() == 1) return sweeps.rows(sweep, blocks.ranges(0), motion);
    team.for_each(blocks.slices(), 1, [&](int slice) {
      IslandMotion own = motion;
      if (slice > 0) {
        const int offset = (slice - 1) * motion.slice_size;
        own.force = own.coordinate_impulse = motion.force_of_slices + offset;
        own.impulse = own.moment = motion.impulse_of_slices + offset;
      }
      sweeps.rows(sweep, blocks.ranges(slice), own);
    });
  }
  void sweep_trees(Sweep sweep, const IslandMotion& motion, Team& team) {
    team.share(static_cast<int>(island_trees.size()), kTreesAtOnce, [&](int, int first, int last) {
      sweeps.trees(sweep, island_trees.data() + first, island_trees.data() + last, motion);
    });
  }
};

// After every micro-step forces and impulses are zero again, but for those on the ground.
void IslandLoop::start(const Trees& trees, const Island& island, RowData& data) {
  for (auto* array : {&velocity, &displacement, &force, &impulse, &moment, &acceleration,
                      &coordinate_impulse, &slowing, &drag, &way, &pull}) {
    array->resize(trees.coordinates, 0.0);
    std::fill_n(array->begin(), kGroundCoordinates, 0.0);
  }
  std::copy_n(data.velocity.begin(), kGroundCoordinates, velocity.begin());
  const size_t of_slices = static_cast<size_t>(blocks.slices() - 1) * trees.coordinates;
  for (auto* array : {&force_of_slices, &impulse_of_slices})
    array->resize(std::max(array->size(), of_slices), 0.0);
  for (int slice = 1; slice < blocks.slices(); ++slice)
    for (auto* array : {&force_of_slices, &impulse_of_slices})
      std::fill_n(array->begin() + (slice - 1) * trees.coordinates, kGroundCoordinates, 0.0);
  island_trees.clear();
  for (int index : island.tree) {
    const Tree& t = trees.tree[index];
    island_trees.push_back(
        {t, blocks.other_slices(index), trees.implicit_of(index), &trees, index});
    for (auto* array :
         {&displacement, &moment, &way, &coordinate_impulse, &data.braked, &data.pulled})
      std::fill_n(array->begin() + t.begin, t.count, 0.0);
    std::copy_n(data.velocity.begin() + t.begin, t.count, velocity.begin() + t.begin);
  }
}

void IslandLoop::finish(RowData& data) const {
  for (const IslandTree& of : island_trees) {
    const Tree& t = of.tree;
    std::copy_n(velocity.begin() + t.begin, t.count, data.velocity.begin() + t.begin);
    std::copy_n(coordinate_impulse.begin() + t.begin, t.count,
                data.coordinate_impulse.begin() + t.begin);
  }
}

IslandMotion IslandLoop::motion(const Trees& trees, RowData& data) {
  IslandMotion m;
  m.velocity = velocity.data();
  m.displacement = displacement.data();
  m.acceleration = acceleration.data();
  m.force = force.data();
  m.impulse = impulse.data();
  m.moment = moment.data();
  m.total_displacement = data.total_displacement.data();
  m.coordinate_impulse = coordinate_impulse.data();
  m.force_of_slices = force_of_slices.data();
  m.impulse_of_slices = impulse_of_slices.data();
  m.slice_size = trees.coordinates;
  m.smooth_acceleration = data.smooth_acceleration.data();
  m.inverse = trees.inverse.data();
  m.start_motion = data.start_motion.data();
  m.added = data.added_acceleration.data();
  m.damping = trees.damping.data();
  m.cross_damping = trees.cross_damping.data();
  m.slowing = slowing.data();
  m.drag = drag.data();
  m.braked = data.braked.data();
  m.stiffness = trees.stiffness.data();
  m.way = way.data();
  m.pull = pull.data();
  m.pulled = data.pulled.data();
  return m;
}

void IslandLoop::run_microsteps(IslandMotion& m, int count, Team& team) {
  const double h = m.h;
  acceleration[kTurningCoordinate] = 1.0;
  double& turning = m.velocity[kTurningCoordinate];
  const double turning_at_start = turning;
  sweep_rows(Sweep::kPrepare, m, team);
  m.rate_time = 0.0;
  for (int i = 0; i < count; ++i) {
    sweep_rows(Sweep::kPresentForces, m, team);
    m.coupled_time = kCoupledShare * h;
    m.work_time = i * h + 0.5 * h;
    m.rate_time = (i + 1) * h;
    turning += h;
    sweep_trees(Sweep::kSmoothMotion, m, team);
    sweep_rows(Sweep::kFlow, m, team);
    sweep_trees(Sweep::kContactMotion, m, team);
  }
  sweep_rows(Sweep::kRead, m, team);
  sweep_trees(Sweep::kDisplacement, m, team);
  const double time = h * count;
  displacement[kSurfaceCoordinate] = time;
  displacement[kTurningCoordinate] = time * (turning_at_start + 0.5 * time);
  sweep_rows(Sweep::kFollow, m, team);
  // A force that is no number shows here alone: rows whose load it is apply none.
  for (const IslandTree& of : island_trees)
    check_bounded(of.tree, acceleration.data(), std::numeric_limits<double>::max());
}

IslandWork IslandLoop::run(const Rows& rows, const Trees& trees, const Island& island,
                           Course course, double recovery_speed, RowData& data, Team& team) {
  // Its stiffness is that of the micro-steps planned.
  const bool at_once = course == Course::kAtOnce;
  const int count = at_once ? 1 : island.microsteps;
  const double h = at_once ? island.microsteps * island.duration : island.duration;
  blocks.pack(rows, trees, island, h, recovery_speed, data, team);
  start(trees, island, data);
  IslandMotion m = motion(trees, data);
  m.h = h;
  m.recovery = recovery_over(island.microsteps * island.duration);
  m.step = h * count;
  run_microsteps(m, count, team);
  finish(data);
  return blocks.unpack(rows, data, team);
}

}  // namespace

struct MicrostepLoop::Impl {
  explicit Impl(int threads) : loops(threads) {}

  std::vector<IslandLoop> loops;  // by worker
  std::vector<Course> course;     // by island
  std::vector<Batch> batches;
  std::vector<IslandWork> work;       // by batch
  std::vector<int> small, in_flight;  // batches that a thread has to itself; trees that none moves
  std::vector<char> moved;            // by tree
  Team alone{1};
};

MicrostepLoop::MicrostepLoop(int threads) : impl_(std::make_unique<Impl>(threads)) {}
MicrostepLoop::~MicrostepLoop() = default;

void MicrostepLoop::run(const Rows& rows, const Trees& trees, const std::vector<Island>& islands,
                        const std::vector<char>& linked, double recovery_speed, double time,
                        RowData& data, Team& team) {
  std::vector<IslandLoop>& loops = impl_->loops;
  std::vector<Course>& course = impl_->course;
  std::vector<Batch>& batches = impl_->batches;
  std::vector<IslandWork>& work = impl_->work;
  std::vector<int>&small = impl_->small, &in_flight = impl_->in_flight;
  std::vector<char>& moved = impl_->moved;
  Team& alone = impl_->alone;
  const int all = static_cast<int>(islands.size());
  course.resize(all);
  team.for_each(all, kGroupsAtOnce, [&](int i) {
    course[i] = stays_apart(rows, islands[i], time, data) ? Course::kApart
                : flows_alone(rows, trees, islands[i], recovery_speed, data)
                    ? Course::kAtOnce
                    : Course::kInMicrosteps;
  });
  moved.assign(trees.tree.size(), 0);
  batches.clear();
  for (int i = 0; i < all; ++i) {
    if (course[i] == Course::kApart) continue;
    const Island& island = islands[i];
    for (int tree : island.tree) moved[tree] = 1;
    if (batches.empty() || !batches.back().may_take(island, course[i])) {
      batches.push_back({island, course[i]});
      continue;
    }
    batches.back().island.group.last = island.group.last;
    batches.back().island.tree.last = island.tree.last;
  }
  const int count_of_batches = static_cast<int>(batches.size());
  work.assign(count_of_batches, IslandWork());
  const auto run_batch = [&](int i, int worker, Team& shared_by) {
    const Batch& batch = batches[i];
    work[i] =
        loops[worker].run(rows, trees, batch.island, batch.course, recovery_speed, data, shared_by);
  };
  small.clear();
  int groups = 0;
  for (int i = 0; i < count_of_batches; ++i) {
    if (IslandBlocks::has_slices(batches[i].island)) {
      run_batch(i, 0, team);
      continue;
    }
    small.push_back(i);
    groups += batches[i].island.group_count();
  }
  const int count = static_cast<int>(small.size());
  team.share(count, groups > 0 ? (count * kGroupsAtOnce + groups - 1) / groups : 1,
             [&](int worker, int first, int last) {
               for (int i = first; i < last; ++i) run_batch(small[i], worker, alone);
             });
  in_flight.clear();
  for (size_t tree = 0; tree < trees.tree.size(); ++tree)
    if (linked[tree] && !moved[tree]) in_flight.push_back(static_cast<int>(tree));
  team.share(
      static_cast<int>(in_flight.size()), kTreesAtOnce, [&](int worker, int first, int last) {
        for (int i = first; i < last; ++i) {
          const Tree& t = trees.tree[in_flight[i]];
          if (!t.damped && !t.sprung) {
            coast(t, time, data);
            continue;
          }
          Island free;
          free.tree = {&in_flight[i], &in_flight[i] + 1};
          free.microsteps = kMinimumMicrosteps;
          free.duration = time / kMinimumMicrosteps;
          loops[worker].run(rows, trees, free, Course::kInMicrosteps, recovery_speed, data, alone);
        }
      });
  for (const IslandWork& of_island : work) {
    data.work += of_island.work;
    data.recovery_input += of_island.recovery_input;
  }
}

}  // namespace dashpot
