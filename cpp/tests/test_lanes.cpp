// The law in lanes against the law for one contact, and rows in lanes against sums term by term.

#include <cmath>
#include <cstring>

#include "checks.hpp"
#include "dashpot/law/friction.hpp"
#include "dashpot/solve/sweep_kernels.hpp"
#include "random_rows.hpp"

namespace {

using namespace dashpot;

using Contact = ContactLanes<6>;

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

// Rows of one coordinate are sparse rows of width one.
void check_joint_rows() {
  double motion[2 * kBodyCoordinates];
  for (double& m : motion) m = uniform(-3.0, 3.0);
  JointLanes joint;
  SparseLanes sparse;
  double value[kLanes];
  alignas(kCacheLine) double room[kLanes][sparse_size(1, 1)] = {};
  int start[kLanes];
  Lanes impulse[1], rates[2][1];
  for (int lane = 0; lane < kLanes; ++lane) {
    // Two lanes share a coordinate.
    joint.column[lane] = kBodyCoordinates + (lane == 3 ? 0 : 2 * lane);
    joint.value[lane] = value[lane] = uniform(-2.0, 2.0);
    pack_sparse(value + lane, joint.column + lane, 1, 1, room[lane], start + lane, lane, sparse);
    impulse[0][lane] = uniform(-2.0, 2.0);
  }
  gather<1>(joint, motion, rates[0]);
  gather<1>(sparse, motion, rates[1]);
  double force[2][2 * kBodyCoordinates] = {};
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
  int column[kLanes][kColumns], width[kLanes], start[kLanes][kColumns];
  double value[kLanes][Dim * kColumns];
  alignas(kCacheLine) double room[kLanes][sparse_size(Dim, kColumns)] = {};
  Lanes impulse[Dim], rate[Dim];
  for (int lane = 0; lane < kLanes - 1; ++lane) {  // the last one is to spare
    width[lane] = 1 + static_cast<int>(uniform(0.0, kColumns));
    for (int k = 0; k < width[lane]; ++k) column[lane][k] = (5 * k + lane) % kColumns;
    for (int i = 0; i < Dim * width[lane]; ++i) value[lane][i] = uniform(-2.0, 2.0);
    pack_sparse(value[lane], column[lane], Dim, width[lane], room[lane], start[lane], lane, sparse);
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
      const double error = Dim == 1 ? 1e-14 : 0.0;  // one row alone is summed in another order
      check(std::abs(rate[i][lane] - expected) <= error, "rate of a sparse row", rate[i][lane],
            expected);
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
    row.unstressed[lane] = lane == 1 ? 1e-6 : 1e-2;
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
  return exit_status();
}
