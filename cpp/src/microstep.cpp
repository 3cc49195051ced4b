#include "dashpot/microstep.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/friction.hpp"
#include "dashpot/row_products.hpp"

namespace dashpot {

namespace {

KelvinVoigt law_of(const Rows& rows, int row) {
  return {rows.stiffness[row], rows.damping[row], rows.inverse_mass[row]};
}

bool is_unilateral(const RowGroup& c) {
  return c.kind == RowKind::kContact || c.kind == RowKind::kUnilateral;
}

class Microstep {
 public:
  Microstep(const Rows& rows, const Trees& trees, const Island& island, double recovery_speed,
            RowData& data)
      : rows_(rows),
        trees_(trees),
        island_(island),
        h_(island.duration),
        recovery_speed_(recovery_speed),
        data_(data) {
    for (int index : island.group) {
      const RowGroup& c = rows.group[index];
      gather(jacobian(c), c, data.smooth_acceleration.data(), data.smooth_load.data() + c.row);
      for (int row = c.row; row < c.row + c.dim; ++row) {
        const KelvinVoigt law = law_of(rows, row);
        data.relaxation[row] =
            law.damping > 0.0 ? std::exp(-law.stiffness * h_ / law.damping) : 0.0;
        const Propagator e = propagate(law, h_);
        if (row == c.row && is_unilateral(c))
          data.propagator[row] = e;
        else
          data.linear_flow[row] = linear_flow(law, e);
      }
    }
  }

  // Rates and deformations as the last micro-step left them, and the acceleration that the present
  // forces of all rows cause together.
  void apply_present_forces() {
    for_each_dof([&](int i) { data_.acceleration[i] = data_.smooth_acceleration[i]; });
    for (int index : island_.group) {
      const RowGroup& c = rows_.group[index];
      read_motion(index, c);
      double* force = data_.force.data() + c.row;
      std::fill(force, force + c.dim, 0.0);
      if (is_unilateral(c) && data_.deformation[c.row] >= 0.0) continue;
      find_present_force(index, c, force);
      scatter(jacobian(c), c, force, data_.acceleration.data());
    }
  }

  // Motion without the rows' impulses.
  void advance_smooth() {
    for_each_dof([&](int i) {
      const double a = data_.smooth_acceleration[i];
      data_.displacement[i] = h_ * (data_.velocity[i] + 0.5 * h_ * a);
      data_.velocity[i] += h_ * a;
    });
  }

  // Closed-form flow of every row under its load, and the motion its impulse causes.
  void flow() {
    for (int index : island_.group) {
      const RowGroup& c = rows_.group[index];
      double load[kMaxRows];
      gather(jacobian(c), c, data_.acceleration.data(), load);
      for (int i = 0; i < c.dim; ++i)
        load[i] -= rows_.inverse_mass[c.row + i] * data_.force[c.row + i];
      if (is_unilateral(c)) {
        flow_normal(index, c, load[0]);
        if (c.dim > 1) flow_friction(index, c, load);
      } else {
        flow_bilateral(index, c, load[0]);
      }
      double* impulse = data_.impulse.data() + c.row;
      if (impulse[0] == 0.0) continue;
      data_.touched[index] = 1;
      scatter(jacobian(c), c, impulse, data_.velocity.data());
      scatter(jacobian(c), c, data_.moment.data() + c.row, data_.displacement.data());
      for (int i = 0; i < c.dim; ++i) data_.total_impulse[c.row + i] += impulse[i];
    }
    for_each_dof([&](int i) { data_.total_displacement[i] += data_.displacement[i]; });
  }

  // Rates and deformations after the last micro-step.
  void read_motion() {
    for (int index : island_.group) read_motion(index, rows_.group[index]);
  }

 private:
  const double* jacobian(const RowGroup& c) const { return rows_.jacobian.data() + c.jacobian; }

  template <typename Function>
  void for_each_dof(Function function) {
    for (int tree : island_.tree) {
      const Tree& t = trees_.tree[tree];
      for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i) function(i);
    }
  }

  // How fast a group's unstressed offset shrinks, m/s or rad/s; that of equalities is recovered by
  // displacement (position_recovery.hpp). Recovery moves bodies, it does not
  // squeeze what cannot move: it pauses while the spring stores more than the kinetic energy of its
  // apparent mass at the recovery speed, k x^2 > v^2 / w.
  double offset_rate(int index, const RowGroup& c) const {
    const double offset = data_.offset[index];
    if (offset == 0.0 || !is_unilateral(c)) return 0.0;
    const double x = data_.deformation[c.row];
    const double v = recovery_speed_;
    const double w = std::max(rows_.inverse_mass[c.row], rows_.typical_inverse_mass[c.row]);
    if (rows_.stiffness[c.row] * w * x * x > v * v) return 0.0;
    return std::clamp(offset / h_, -v, v);
  }

  // Rates, the work of the last impulses, and deformations: springs follow the relative motion,
  // the unstressed offset recovers, springs behind a slipping slider relax towards the limit
  // (k s + d s' = -p/h).
  void read_motion(int index, const RowGroup& c) {
    double rate[kMaxRows], displacement[kMaxRows];
    gather(jacobian(c), c, data_.velocity.data(), rate);
    gather(jacobian(c), c, data_.displacement.data(), displacement);
    displacement[0] -= h_ * data_.surface[index];
    data_.offset[index] -= h_ * data_.surface[index];
    for (int i = 0; i < c.dim; ++i) {
      const int row = c.row + i;
      const bool slides = i > 0 || c.kind == RowKind::kSlider;
      const double p = data_.impulse[row];
      double& deformation = data_.deformation[row];
      if (slides && rows_.friction[row] == 0.0) {
        deformation = 0.0;  // a slider without friction loads no spring
      } else if (slides && !data_.sticking[index]) {
        const double limit = -p / (rows_.stiffness[row] * h_);
        deformation = limit + data_.relaxation[row] * (deformation - limit);
      } else {
        deformation += displacement[i];
      }
      share(data_.work, c, i) += 0.5 * p * (data_.rate[row] + rate[i]) +
                                 data_.smooth_load[row] * (0.5 * h_ * p - data_.moment[row]);
      data_.rate[row] = rate[i];
    }
    data_.surface[index] = offset_rate(index, c);
  }

  void find_present_force(int index, const RowGroup& c, double* force) const {
    for (int i = 0; i < c.dim; ++i) {
      const int row = c.row + i;
      force[i] =
          -rows_.stiffness[row] * data_.deformation[row] - rows_.damping[row] * data_.rate[row];
    }
    force[0] += rows_.damping[c.row] * data_.surface[index];
    if (c.kind == RowKind::kSlider) {
      const double limit = rows_.friction[c.row];
      force[0] = std::clamp(force[0], -limit, limit);
    }
    if (!is_unilateral(c)) return;
    force[0] = std::max(0.0, force[0]);
    if (c.dim > 1) return_friction(c, force);
  }

  void flow_normal(int index, const RowGroup& c, double load) {
    const double surface = data_.surface[index];
    const Flow flow = flow_contact(law_of(rows_, c.row), data_.deformation[c.row],
                                   data_.rate[c.row] - surface, load, h_, &data_.propagator[c.row]);
    data_.impulse[c.row] = flow.impulse;
    data_.moment[c.row] = flow.moment;
    share(data_.recovery_input, c, 0) += flow.impulse * surface;
  }

  // Impulse and moment of a spring-damper row.
  void flow_spring_row(int row, double rate, double load) {
    const LinearFlow& flow = data_.linear_flow[row];
    const double x = data_.deformation[row];
    data_.impulse[row] = flow.impulse[0] * x + flow.impulse[1] * rate + flow.impulse[2] * load;
    data_.moment[row] = flow.moment[0] * x + flow.moment[1] * rate + flow.moment[2] * load;
  }

  // Friction impulses or forces behind the normal one are returned to the limit surface; true if
  // the contact sticks.
  bool return_friction(const RowGroup& c, double* impulse) const {
    double response[kMaxFrictionDirections];
    for (int i = 1; i < c.dim; ++i) response[i - 1] = -data_.linear_flow[c.row + i].impulse[1];
    return return_to_limit(impulse + 1, rows_.friction.data() + c.row + 1, response, c.dim - 1,
                           impulse[0]);
  }

  void flow_friction(int index, const RowGroup& c, const double* load) {
    double* impulse = data_.impulse.data() + c.row;
    double* moment = data_.moment.data() + c.row;
    data_.sticking[index] = 0;
    if (impulse[0] == 0.0) {
      std::fill(impulse + 1, impulse + c.dim, 0.0);
      std::fill(moment + 1, moment + c.dim, 0.0);
      return;
    }
    for (int i = 1; i < c.dim; ++i) flow_spring_row(c.row + i, data_.rate[c.row + i], load[i]);
    data_.sticking[index] = return_friction(c, impulse);
    for (int i = 1; i < c.dim; ++i)
      if (rows_.friction[c.row + i] == 0.0) moment[i] = 0.0;
    // A slipping contact carries mu f_n throughout, so its moments are in the normal's proportion.
    if (!data_.sticking[index])
      for (int i = 1; i < c.dim; ++i) moment[i] = impulse[i] * (moment[0] / impulse[0]);
  }

  void flow_bilateral(int index, const RowGroup& c, double load) {
    flow_spring_row(c.row, data_.rate[c.row], load);
    double& impulse = data_.impulse[c.row];
    data_.sticking[index] = 1;
    if (c.kind == RowKind::kSlider) {
      const double limit = rows_.friction[c.row] * h_;
      data_.sticking[index] = std::abs(impulse) <= limit;
      if (!data_.sticking[index]) {
        impulse = std::copysign(limit, impulse);
        data_.moment[c.row] = 0.5 * h_ * impulse;
      }
    }
  }

  const Rows& rows_;
  const Trees& trees_;
  const Island& island_;
  const double h_;
  const double recovery_speed_;
  RowData& data_;
};

}  // namespace

double& share(EnergyShares& shares, const RowGroup& c, int i) {
  if (c.kind != RowKind::kContact) return shares.constraint;
  return i == 0 ? shares.normal : shares.friction;
}

void RowData::reset_motion(int dofs) {
  for (auto* array :
       {&velocity, &smooth_acceleration, &displacement, &total_displacement, &acceleration})
    array->assign(dofs, 0.0);
}

void RowData::reset_rows(const Rows& rows) {
  const size_t row_count = rows.inverse_mass.size();
  const size_t group_count = rows.group.size();
  for (auto* array :
       {&deformation, &rate, &force, &impulse, &moment, &total_impulse, &smooth_load, &relaxation})
    array->assign(row_count, 0.0);
  propagator.resize(row_count);
  linear_flow.resize(row_count);
  offset.assign(group_count, 0.0);
  surface.assign(group_count, 0.0);
  sticking.assign(group_count, 1);
  touched.assign(group_count, 0);
  work = recovery_input = EnergyShares{};
}

void run_microsteps(const Rows& rows, const Trees& trees, const Island& island,
                    double recovery_speed, RowData& data) {
  Microstep microstep(rows, trees, island, recovery_speed, data);
  for (int i = 0; i < island.microsteps; ++i) {
    microstep.apply_present_forces();
    microstep.advance_smooth();
    microstep.flow();
  }
  microstep.read_motion();
}

bool overlaps_semi_implicitly(const Rows& rows, const RowGroup& c, double gap,
                              const double* velocity, const double* acceleration, double time) {
  if (!is_unilateral(c) || gap <= 0.0) return false;
  double rate[kMaxRows], load[kMaxRows];
  const double* jacobian = rows.jacobian.data() + c.jacobian;
  gather(jacobian, c, velocity, rate);
  gather(jacobian, c, acceleration, load);
  return gap + time * (rate[0] + time * load[0]) <= 0.0;
}

bool stays_apart(const Rows& rows, const Island& island, double time, const RowData& data) {
  for (int index : island.group) {
    const RowGroup& c = rows.group[index];
    const double gap = data.deformation[c.row];
    if (!is_unilateral(c) || gap <= 0.0) return false;
    double rate[kMaxRows], load[kMaxRows];
    const double* jacobian = rows.jacobian.data() + c.jacobian;
    gather(jacobian, c, data.velocity.data(), rate);
    gather(jacobian, c, data.smooth_acceleration.data(), load);
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
