// The sweeps of a micro-step under every instruction set that the processor has against the
// portable ones, bit for bit.

#include <cstring>
#include <tuple>
#include <vector>

#include "checks.hpp"
#include "dashpot/lanes/aligned.hpp"
#include "dashpot/solve/sweep_kernels.hpp"
#include "random_rows.hpp"

namespace {

using namespace dashpot;

// Laws of any kind, and Jacobians of rows over some of `bodies`, whose sparse ones point to what is
// kept in a SparseRoom.
template <int Dim>
void fill_law(double h, ContactLanes<Dim>& law) {
  law = random_contacts<Dim>(h);
  for (int lane = 0; lane < kLanes; ++lane) {
    law.loaded_friction[lane] = uniform(0.1, 1.0);
    law.inverse_friction_load[lane] = log_uniform(1e-3, 10.0);
    for (Lanes& turning : law.turning) turning[lane] = uniform(-1.0, 1.0);
    law.ahead[lane] = uniform(0.0, 1e-3);
    law.drift[lane] = uniform(-1e-3, 1e-3);
    for (auto& of_row : law.relaxation) of_row.relaxation[lane] = uniform(0.0, 1.0);
    law.bearable[lane] = 1e-4;
    law.recovery_speed[lane] = 0.1;
    law.unstressed[lane] = uniform(-1e-4, 1e-4);
  }
  law.load_dependent = law.turns = uniform(0.0, 1.0) < 0.5;
}
void fill_law(double h, SpringLanes& law) {
  law = SpringLanes{};
  fill_rows(h, law);
  for (int lane = 0; lane < kLanes; ++lane) {
    law.limit[lane] = log_uniform(1e-3, 10.0);
    law.relaxation.relaxation[lane] = uniform(0.0, 1.0);
  }
}

struct SparseRoom {
  AlignedDoubles values;
  std::vector<int> columns, starts;
};

template <int Dim>
void fill_jacobian(int bodies, PairLanes& j, SparseRoom&) {
  for (int lane = 0; lane < kLanes; ++lane) {
    const int first = static_cast<int>(uniform(0.0, bodies));
    for (int k = 0; k < 3; ++k) {
      j.frame[4 * k][lane] = 1.0;
      for (auto& arm : j.arm) arm[k][lane] = uniform(-0.1, 0.1);
    }
    j.body[0][lane] = kGroundCoordinates + kBodyCoordinates * first;
    j.body[1][lane] = kGroundCoordinates + kBodyCoordinates * ((first + 1) % bodies);
  }
}
template <int Dim>
void fill_jacobian(int bodies, JointLanes& j, SparseRoom&) {
  for (int lane = 0; lane < kLanes; ++lane) {
    j.value[lane] = uniform(-2.0, 2.0);
    j.column[lane] = kGroundCoordinates +
                     kBodyCoordinates * static_cast<int>(uniform(0.0, bodies)) +
                     static_cast<int>(uniform(0.0, 3.0));
  }
}
template <int Dim>
void fill_jacobian(int bodies, SparseLanes& j, SparseRoom& room) {
  constexpr int kColumns = 5, kSize = padded(sparse_size(Dim, kColumns));
  room.values.assign(kLanes * kSize, 0.0);
  room.columns.resize(kLanes * kColumns);
  room.starts.resize(kLanes * kColumns);
  for (int lane = 0; lane < kLanes; ++lane) {
    double value[Dim * kColumns];
    for (double& v : value) v = uniform(-1.0, 1.0);
    int* column = room.columns.data() + lane * kColumns;
    for (int k = 0; k < kColumns; ++k)
      column[k] = kGroundCoordinates + kBodyCoordinates * ((3 * lane + k) % bodies);
    const int width = 1 + static_cast<int>(uniform(0.0, kColumns));
    pack_sparse(value, column, Dim, width, room.values.data() + lane * kSize,
                room.starts.data() + lane * kColumns, lane, j);
  }
}

// Bodies that rows of one kind act on, swept as a micro-step does.
template <typename Jacobian, typename Law>
struct Swept {
  static constexpr int kBodies = 9, kBlocks = 3;
  std::vector<Block<Jacobian, Law>> blocks{kBlocks};
  std::vector<SparseRoom> rooms{kBlocks};
  std::vector<IslandTree> trees;
  AlignedDoubles arrays[10];

  explicit Swept(double h) {
    for (auto& array : arrays) array.assign(kGroundCoordinates + kBodyCoordinates * kBodies, 0.0);
    arrays[8].assign(kBodyCoordinates * kBodyCoordinates * kBodies, 0.0);
    for (int i = 0; i < kBodies; ++i) {
      Tree t;
      t.begin = kGroundCoordinates + kBodyCoordinates * i;
      t.count = kBodyCoordinates;
      t.free_body = i % 3 != 2;
      t.dof_count = 6;
      t.inverse = kBodyCoordinates * kBodyCoordinates * i;
      for (int j = 0; j < 3; ++j) {
        arrays[0][t.begin + j] = uniform(-1.0, 1.0);
        arrays[0][t.begin + 4 + j] = t.free_body ? uniform(-9.0, 9.0) : 0.0;
        arrays[7][t.begin + j] = uniform(-10.0, 10.0);
      }
      // So heavy that rows as stiff as those of random_contacts() are resolved together.
      double* inverse = arrays[8].data() + t.inverse;
      if (t.free_body) {
        for (int j = 0; j < 3; ++j) {
          inverse[j] = 5e-4;
          inverse[4 * (j + 1) + j] = uniform(0.02, 0.06);
        }
      } else {
        for (int j = 0; j < t.dof_count; ++j) inverse[(t.count + 1) * j] = uniform(1e-4, 5e-4);
      }
      trees.push_back({t, 0});
    }
    for (int i = 0; i < kBlocks; ++i) {
      fill_law(h, blocks[i].law);
      fill_jacobian<Block<Jacobian, Law>::kDim>(kBodies, blocks[i].jacobian, rooms[i]);
    }
  }

  IslandMotion motion(double h) {
    IslandMotion m;
    m.h = h;
    m.recovery = recovery_over(0.002);
    m.coupled_time = kCoupledShare * h;
    m.rate_time = m.work_time = h;
    double** array[] = {&m.velocity, &m.displacement, &m.acceleration,      &m.force,
                        &m.impulse,  &m.moment,       &m.total_displacement};
    for (int i = 0; i < 7; ++i) *array[i] = arrays[i].data();
    m.smooth_acceleration = arrays[7].data();
    m.inverse = arrays[8].data();
    m.coordinate_impulse = arrays[9].data();
    return m;
  }
};

// With the sweeps of one instruction set.
template <typename Jacobian, typename Law>
Swept<Jacobian, Law> run(Swept<Jacobian, Law> swept, double h, const SweepFunctions& sweeps) {
  const IslandMotion m = swept.motion(h);
  BlockRanges blocks;
  std::get<BlockRange<Jacobian, Law>>(blocks) = {swept.blocks.data(),
                                                 swept.blocks.data() + swept.blocks.size()};
  const auto rows = [&](Sweep sweep) { sweeps.rows(sweep, blocks, m); };
  const auto trees = [&](Sweep sweep) {
    sweeps.trees(sweep, swept.trees.data(), swept.trees.data() + swept.trees.size(), m);
  };
  rows(Sweep::kPrepare);
  for (int i = 0; i < 20; ++i) {
    rows(Sweep::kPresentForces);
    trees(Sweep::kSmoothMotion);
    rows(Sweep::kFlow);
    trees(Sweep::kContactMotion);
  }
  rows(Sweep::kRead);
  trees(Sweep::kDisplacement);
  rows(Sweep::kFollow);
  return swept;
}

template <typename Jacobian, typename Law>
void check_equal_bits(const Swept<Jacobian, Law>& a, const Swept<Jacobian, Law>& b,
                      const char* claim) {
  const auto same = [](const auto& x, const auto& y) { return std::memcmp(&x, &y, sizeof x) == 0; };
  for (int i : {0, 6, 9})
    check(std::memcmp(a.arrays[i].data(), b.arrays[i].data(),
                      a.arrays[i].size() * sizeof(double)) == 0,
          claim, a.arrays[i][kGroundCoordinates], b.arrays[i][kGroundCoordinates]);
  for (int i = 0; i < a.kBlocks; ++i) {
    const Law &x = a.blocks[i].law, &y = b.blocks[i].law;
    check(same(x.deformation, y.deformation) && same(x.total_impulse, y.total_impulse) &&
              same(x.work, y.work) && same(x.unstressed, y.unstressed) &&
              same(x.sticking, y.sticking),
          claim, x.deformation[0][0], y.deformation[0][0]);
  }
}

template <typename Jacobian, typename Law>
void check_instruction_sets(const BlockRange<Jacobian, Law>&) {
  const double h = 1e-4;
  bool carried = false;
  for (int i = 0; i < 50; ++i) {
    const Swept<Jacobian, Law> start(h);
    const Swept<Jacobian, Law> portable = run(start, h, kPortableSweeps);
    for (double impulse : portable.arrays[9]) carried = carried || impulse != 0.0;
#if defined(__x86_64__)
    if (has_avx2()) check_equal_bits(portable, run(start, h, kAvx2Sweeps), "AVX2 gives equal bits");
    if (has_avx512())
      check_equal_bits(portable, run(start, h, kAvx512Sweeps), "AVX-512 gives equal bits");
#endif
  }
  check(carried, "rows carried impulses", 0, 1);
}

}  // namespace

int main() {
  std::apply([](const auto&... kind) { (check_instruction_sets(kind), ...); }, BlockRanges());
  return exit_status();
}
