// The law in lanes against the law for one contact, and the sweeps of a micro-step under every
// instruction set that the processor has against the portable ones, bit for bit.

#include <cmath>
#include <cstdio>
#include <cstring>
#include <random>
#include <tuple>
#include <type_traits>
#include <vector>

#include "dashpot/lanes/aligned.hpp"
#include "dashpot/law/friction.hpp"
#include "dashpot/microsteps/sweep_kernels.hpp"

namespace {

using namespace dashpot;

int failures = 0;
std::mt19937_64 generator(7);

void check(bool passed, const char* claim, double got, double expected) {
  if (passed) return;
  if (++failures <= 20) std::printf("failed: %s: %.17g against %.17g\n", claim, got, expected);
}

void check_close(double got, double expected, double scale, double tolerance, const char* claim) {
  check(std::fabs(got - expected) <= tolerance * scale, claim, got, expected);
}

double uniform(double low, double high) {
  return std::uniform_real_distribution<double>(low, high)(generator);
}
double log_uniform(double low, double high) {
  return std::exp(uniform(std::log(low), std::log(high)));
}

using Contact = ContactLanes<6>;

// Four groups of rows of any stiffness and damping, some of them open.
template <int Dim>
void fill_rows(double h, RowLanes<Dim>& c) {
  for (int lane = 0; lane < kLanes; ++lane) {
    for (int i = 0; i < Dim; ++i) {
      const double w = c.inverse_mass[i][lane] = log_uniform(0.01, 100.0);
      const double frequency = log_uniform(1e-3, 3.0) / h;
      c.stiffness[i][lane] = frequency * frequency / w;
      c.damping[i][lane] = 2.0 * uniform(0.0, 2.0) * frequency / w;
      c.deformation[i][lane] = uniform(-1e-3, i == 0 ? 2e-4 : 1e-3);
      c.rate[i][lane] = uniform(-0.5, 0.5);
    }
    c.sticking[lane] = -1;
  }
}

// Four contacts, some without friction in a direction.
template <int Dim>
ContactLanes<Dim> random_contacts(double h) {
  ContactLanes<Dim> c{};
  fill_rows(h, c);
  for (int lane = 0; lane < kLanes; ++lane)
    for (int i = 1; i < Dim; ++i) {
      double& inverse = c.inverse_friction[i - 1][lane];
      inverse = uniform(0.0, 1.0) < 0.2 ? 0.0 : 1.0 / log_uniform(0.01, 2.0);
      if (inverse == 0.0) c.stiffness[i][lane] = c.damping[i][lane] = 0.0;
    }
  return c;
}

KelvinVoigt law_of(const Contact& c, int i, int lane) {
  return {c.stiffness[i][lane], c.damping[i][lane], c.inverse_mass[i][lane]};
}

void check_propagators(const Contact& c, double h) {
  for (int lane = 0; lane < kLanes; ++lane) {
    const Propagator e = propagate(law_of(c, 0, lane), h);
    const double expected[5] = {e.e0, e.e1, e.e2, e.e3, e.e4};
    double scale = 1.0;
    // Both are accurate to 1e-13; e0 and e1 cross zero, so all are taken relative to h^n.
    for (int n = 0; n < 5; ++n, scale *= h)
      check_close(c.e[n][lane], expected[n], scale, 1e-12, "propagator");
  }
}

void check_normals(Contact c, double h) {
  Lanes load, moment;
  for (int lane = 0; lane < kLanes; ++lane) load[lane] = uniform(-50.0, 50.0);
  flow_normal(c, load, h, moment);
  for (int lane = 0; lane < kLanes; ++lane) {
    const KelvinVoigt law = law_of(c, 0, lane);
    const double x = c.deformation[0][lane], u = c.rate[0][lane];
    const Flow flow = flow_contact(law, x, u, load[lane], h);
    // Impulses of the terms that make them up, which may cancel.
    const double scale = (law.stiffness * (std::fabs(x) + h * std::fabs(u)) +
                          law.damping * (std::fabs(u) + h * std::fabs(load[lane])) +
                          law.stiffness * h * h * std::fabs(load[lane])) *
                         h;
    check_close(c.impulse[0][lane], flow.impulse, scale, 1e-12, "normal impulse");
    check_close(moment[lane], flow.moment, scale * h, 1e-12, "normal moment");
  }
}

// With coefficients that fall under load, or not.
void check_friction(Contact c, double h, bool load_dependent) {
  Lanes impulse[6];
  c.load_dependent = load_dependent;
  for (int lane = 0; lane < kLanes; ++lane) {
    impulse[0][lane] = uniform(0.0, 1.0) < 0.1 ? 0.0 : log_uniform(1e-3, 10.0);
    for (int i = 1; i < 6; ++i)
      impulse[i][lane] = c.inverse_friction[i - 1][lane] == 0.0 ? 0.0 : uniform(-3.0, 3.0);
    c.loaded_friction[lane] = uniform(0.1, 1.0);
    c.inverse_friction_load[lane] = h / log_uniform(1e-3, 10.0);
  }
  Lanes returned[6];
  std::memcpy(returned, impulse, sizeof impulse);
  const Lanes limit = find_pressure(c, returned[0], h);
  const LaneMask inside = find_sticking(c, returned, limit);
  return_friction(c, returned, limit, inside);
  for (int lane = 0; lane < kLanes; ++lane) {
    double expected[5], mu[5], response[5], largest = 0.0;
    const double share = c.loaded_friction[lane];
    const double loads = impulse[0][lane] / h * c.inverse_friction_load[lane];
    const double pressure =
        impulse[0][lane] * (load_dependent ? share + (1.0 - share) / (1.0 + loads) : 1.0);
    for (int i = 0; i < 5; ++i) {
      expected[i] = impulse[i + 1][lane];
      const double inverse = c.inverse_friction[i][lane];
      mu[i] = inverse > 0.0 ? 1.0 / inverse : 0.0;
      response[i] = c.slip[i][lane] * mu[i] * mu[i];
      largest = std::max(largest, mu[i] * impulse[0][lane]);
    }
    const bool sticks = return_to_limit(expected, mu, response, 5, pressure);
    if (impulse[0][lane] > 0.0)
      check(sticks == (inside[lane] != 0), "sticking", inside[lane] != 0, sticks);
    // Either stops within 1e-9 of the surface, relative to its half axes.
    for (int i = 0; i < 5; ++i)
      check_close(returned[i + 1][lane], expected[i], largest, 1e-7, "friction on its surface");
  }
}

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
    law.offset[lane] = uniform(-1e-4, 1e-4);
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
  std::vector<int> columns;
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
  for (int lane = 0; lane < kLanes; ++lane) {
    double value[Dim * kColumns];
    for (double& v : value) v = uniform(-1.0, 1.0);
    int* column = room.columns.data() + lane * kColumns;
    for (int k = 0; k < kColumns; ++k)
      column[k] = kGroundCoordinates + kBodyCoordinates * ((3 * lane + k) % bodies);
    const int width = 1 + static_cast<int>(uniform(0.0, kColumns));
    pack_sparse(value, column, Dim, width, room.values.data() + lane * kSize, lane, j);
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
              same(x.work, y.work) && same(x.offset, y.offset) && same(x.sticking, y.sticking),
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

// Rows of one coordinate are sparse rows of width one.
void check_joint_rows() {
  double motion[kBodyCoordinates + 6];
  for (double& m : motion) m = uniform(-3.0, 3.0);
  JointLanes joint;
  SparseLanes sparse;
  double value[kLanes];
  alignas(kCacheLine) double room[kLanes][sparse_size(1, 1)] = {};
  Lanes impulse[1], rates[2][1];
  for (int lane = 0; lane < kLanes; ++lane) {
    // Two lanes share a coordinate.
    joint.column[lane] = kBodyCoordinates + (lane == 3 ? 0 : 2 * lane);
    joint.value[lane] = value[lane] = uniform(-2.0, 2.0);
    pack_sparse(value + lane, joint.column + lane, 1, 1, room[lane], lane, sparse);
    impulse[0][lane] = uniform(-2.0, 2.0);
  }
  gather<1>(joint, motion, rates[0]);
  gather<1>(sparse, motion, rates[1]);
  double force[2][kBodyCoordinates + 6] = {};
  scatter<1>(joint, impulse, force[0]);
  scatter<1>(sparse, impulse, force[1]);
  for (int lane = 0; lane < kLanes; ++lane) {
    check(rates[0][0][lane] == rates[1][0][lane], "rates of joints", rates[0][0][lane],
          rates[1][0][lane]);
    check(force[0][joint.column[lane]] == force[1][joint.column[lane]], "forces on joints",
          force[0][joint.column[lane]], force[1][joint.column[lane]]);
  }
  check(force[0][kBodyCoordinates] != 0.0, "joints are loaded", 0, 1);
}

// Sparse rows of all widths, against sums term by term.
template <int Dim>
void check_sparse_rows() {
  constexpr int kColumns = 12;
  double motion[kColumns];
  for (double& m : motion) m = uniform(-3.0, 3.0);
  SparseLanes sparse{};
  int column[kLanes][kColumns], width[kLanes];
  double value[kLanes][Dim * kColumns];
  alignas(kCacheLine) double room[kLanes][sparse_size(Dim, kColumns)] = {};
  Lanes impulse[Dim], rate[Dim];
  for (int lane = 0; lane < kLanes - 1; ++lane) {  // the last one is to spare
    width[lane] = 1 + static_cast<int>(uniform(0.0, kColumns));
    for (int k = 0; k < width[lane]; ++k) column[lane][k] = (5 * k + lane) % kColumns;
    for (int i = 0; i < Dim * width[lane]; ++i) value[lane][i] = uniform(-2.0, 2.0);
    pack_sparse(value[lane], column[lane], Dim, width[lane], room[lane], lane, sparse);
    for (Lanes& p : impulse) p[lane] = uniform(-2.0, 2.0);
  }
  gather<Dim>(sparse, motion, rate);
  double force[kColumns] = {}, expected_force[kColumns] = {};
  scatter<Dim>(sparse, impulse, force);
  for (int lane = 0; lane < kLanes - 1; ++lane) {
    for (int i = 0; i < Dim; ++i) {
      double expected = 0.0;
      for (int k = 0; k < width[lane]; ++k)
        expected += value[lane][i * width[lane] + k] * motion[column[lane][k]];
      check(rate[i][lane] == expected, "rate of a sparse row", rate[i][lane], expected);
    }
    for (int k = 0; k < width[lane]; ++k) {
      double sum = 0.0;
      for (int i = 0; i < Dim; ++i) sum += value[lane][i * width[lane] + k] * impulse[i][lane];
      expected_force[column[lane][k]] += sum;
    }
  }
  for (int i = 0; i < Dim; ++i)
    check(rate[i][kLanes - 1] == 0.0, "rate of a lane to spare", rate[i][kLanes - 1], 0.0);
  for (int k = 0; k < kColumns; ++k)
    check(force[k] == expected_force[k], "force of sparse rows", force[k], expected_force[k]);
}

// Offsets recover unless the spring is deformed, either way, by more than is bearable.
void check_recovery() {
  RowLanes<1> row{};
  const double speed = 0.1, bearable = 2e-5, factor[kLanes] = {-1.1, -0.9, 0.9, 1.1};
  const Recovery recovery = recovery_over(0.02);
  for (int lane = 0; lane < kLanes; ++lane) {
    row.bearable[lane] = bearable;
    row.recovery_speed[lane] = speed;
    row.offset[lane] = lane == 1 ? 1e-6 : 1e-2;
    row.deformation[0][lane] = factor[lane] * bearable;
  }
  const Lanes rate = offset_rate(row, recovery);
  const double expected[kLanes] = {0.0, 1e-6 / (kRecoverySteps * 0.02), speed, 0.0};
  for (int lane = 0; lane < kLanes; ++lane)
    check_close(rate[lane], expected[lane], speed, 1e-15, "rate of recovery");
}

}  // namespace

int main() {
  for (int i = 0; i < 5000; ++i) {
    const double h = log_uniform(1e-5, 1e-3);
    Contact c = random_contacts<6>(h);
    prepare(c, h);
    check_propagators(c, h);
    check_normals(c, h);
    check_friction(c, h, false);
    check_friction(c, h, true);
  }
  for (int i = 0; i < 1000; ++i) check_joint_rows();
  for (int i = 0; i < 300; ++i) {
    check_sparse_rows<1>();
    check_sparse_rows<3>();
    check_sparse_rows<4>();
    check_sparse_rows<6>();
  }
  check_recovery();
  std::apply([](const auto&... kind) { (check_instruction_sets(kind), ...); }, BlockRanges());
  if (failures > 0) std::printf("%d checks failed\n", failures);
  return failures > 0 ? 1 : 0;
}
