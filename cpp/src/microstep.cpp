#include "dashpot/microstep.hpp"

#include <algorithm>
#include <cmath>

#include "dashpot/friction.hpp"

namespace dashpot {

namespace {

double gather(const double* row, const RowGroup& c, const double* y) {
  double sum = 0.0;
  const double* first = y + c.dof_begin[0];
  for (int i = 0; i < c.dof_count[0]; ++i) sum += row[i] * first[i];
  const double* second = y + c.dof_begin[1];
  row += c.dof_count[0];
  for (int i = 0; i < c.dof_count[1]; ++i) sum += row[i] * second[i];
  return sum;
}

void scatter(const double* row, const RowGroup& c, double factor, double* y) {
  double* first = y + c.dof_begin[0];
  for (int i = 0; i < c.dof_count[0]; ++i) first[i] += row[i] * factor;
  double* second = y + c.dof_begin[1];
  row += c.dof_count[0];
  for (int i = 0; i < c.dof_count[1]; ++i) second[i] += row[i] * factor;
}

KelvinVoigt law_of(const Rows& rows, int row) {
  return {rows.stiffness[row], rows.damping[row], rows.inverse_mass[row]};
}

// How fast the unstressed offset shrinks during a micro-step, m/s or rad/s.
double offset_rate(double offset, double recovery_speed, double h) {
  return std::clamp(offset / h, -recovery_speed, recovery_speed);
}

bool is_unilateral(const RowGroup& c) {
  return c.kind == RowKind::kContact || c.kind == RowKind::kUnilateral;
}

// Where the energy of row i of a group belongs.
double& share(EnergyShares& shares, const RowGroup& c, int i) {
  if (c.kind != RowKind::kContact) return shares.constraint;
  return i == 0 ? shares.normal : shares.friction;
}

// Friction impulses are returned to the limit surface; true if the contact sticks.
bool return_to_limit(const Rows& rows, const RowGroup& c, double normal, double* friction) {
  const double* mu = rows.friction.data() + c.row + 1;
  for (int i = 0; i < c.dim - 1; ++i)
    if (mu[i] == 0.0) friction[i] = 0.0;
  const double scale = radial_return(friction, mu, c.dim - 1, normal);
  if (scale >= 1.0) return true;
  for (int i = 0; i < c.dim - 1; ++i) friction[i] *= scale;
  return false;
}

class Microstep {
 public:
  Microstep(const Rows& rows, const Trees& trees, const Island& island, double recovery_speed,
            RowData& data)
      : rows_(rows), trees_(trees), island_(island), recovery_speed_(recovery_speed), data_(data) {
    for (int index : island.group) {
      const RowGroup& c = rows.group[index];
      for (int row = c.row; row < c.row + c.dim; ++row)
        data.propagator[row] = propagate(law_of(rows, row), island.duration);
    }
  }

  // Gap rates, and the work that the last micro-step's impulses did on the bodies.
  void read_rates() {
    for (int index : island_.group) {
      const RowGroup& c = rows_.group[index];
      for (int i = 0; i < c.dim; ++i) {
        const int row = c.row + i;
        const double rate = gather(jacobian(c, i), c, data_.velocity.data());
        const double work = 0.5 * data_.impulse[row] * (data_.rate[row] + rate);
        share(data_.work, c, i) += work;
        data_.rate[row] = rate;
      }
    }
  }

  // The force of every contact in its present state, and the acceleration they cause together.
  void apply_present_forces() {
    for_each_dof([&](int i) { data_.acceleration[i] = data_.smooth_acceleration[i]; });
    for (int index : island_.group) {
      const RowGroup& c = rows_.group[index];
      double* force = data_.force.data() + c.row;
      std::fill(force, force + c.dim, 0.0);
      present_force(index, c, force);
      for (int i = 0; i < c.dim; ++i)
        if (force[i] != 0.0) scatter(jacobian(c, i), c, force[i], data_.acceleration.data());
    }
  }

  // Impulse and moment of every row over the micro-step.
  void flow() {
    for (int index : island_.group) {
      const RowGroup& c = rows_.group[index];
      if (is_unilateral(c)) {
        flow_normal(index, c);
        if (c.dim > 1) flow_friction(index, c);
      } else {
        flow_bilateral(index, c);
      }
      if (data_.impulse[c.row] != 0.0) data_.touched[index] = 1;
    }
  }

  void advance() {
    const double h = island_.duration;
    for_each_dof([&](int i) {
      const double a = data_.smooth_acceleration[i];
      data_.displacement[i] = h * data_.velocity[i] + 0.5 * h * h * a;
      data_.velocity[i] += h * a;
    });
    for (int index : island_.group) {
      const RowGroup& c = rows_.group[index];
      if (data_.impulse[c.row] == 0.0) continue;
      for (int i = 0; i < c.dim; ++i) {
        const int row = c.row + i;
        scatter(jacobian(c, i), c, data_.impulse[row], data_.velocity.data());
        scatter(jacobian(c, i), c, data_.moment[row], data_.displacement.data());
        data_.total_impulse[row] += data_.impulse[row];
      }
    }
    for (int index : island_.group) deform(index, rows_.group[index]);
    for_each_dof([&](int i) { data_.total_displacement[i] += data_.displacement[i]; });
  }

 private:
  const double* jacobian(const RowGroup& c, int i) const {
    return rows_.jacobian.data() + c.jacobian + i * c.stride;
  }

  template <typename Function>
  void for_each_dof(Function function) {
    for (int tree : island_.tree) {
      const Tree& t = trees_.tree[tree];
      for (int i = t.dof_begin; i < t.dof_begin + t.dof_count; ++i) function(i);
    }
  }

  void present_force(int index, const RowGroup& c, double* force) const {
    const double x = data_.deformation[c.row];
    if (is_unilateral(c) && x >= 0.0) return;
    const double rate =
        data_.rate[c.row] - offset_rate(data_.offset[index], recovery_speed_, island_.duration);
    force[0] = -rows_.stiffness[c.row] * x - rows_.damping[c.row] * rate;
    if (is_unilateral(c)) force[0] = std::max(0.0, force[0]);
    if (c.kind == RowKind::kSlider) {
      const double limit = rows_.friction[c.row];
      force[0] = std::clamp(force[0], -limit, limit);
    }
    if (c.dim == 1) return;
    for (int i = 1; i < c.dim; ++i) {
      const int row = c.row + i;
      force[i] =
          -rows_.stiffness[row] * data_.deformation[row] - rows_.damping[row] * data_.rate[row];
    }
    return_to_limit(rows_, c, force[0], force + 1);
  }

  // Load on a row from everything but its own present force.
  double load(const RowGroup& c, int i) const {
    return gather(jacobian(c, i), c, data_.acceleration.data()) -
           rows_.inverse_mass[c.row + i] * data_.force[c.row + i];
  }

  void flow_normal(int index, const RowGroup& c) {
    const double h = island_.duration;
    const double surface = offset_rate(data_.offset[index], recovery_speed_, h);
    const Flow flow =
        flow_contact(law_of(rows_, c.row), data_.deformation[c.row], data_.rate[c.row] - surface,
                     load(c, 0), h, &data_.propagator[c.row]);
    data_.impulse[c.row] = flow.impulse;
    data_.moment[c.row] = flow.moment;
    share(data_.recovery_input, c, 0) += flow.impulse * surface;
  }

  void flow_bilateral(int index, const RowGroup& c) {
    const double h = island_.duration;
    const double surface = offset_rate(data_.offset[index], recovery_speed_, h);
    const Flow flow =
        flow_spring(law_of(rows_, c.row), data_.deformation[c.row], data_.rate[c.row] - surface,
                    load(c, 0), h, &data_.propagator[c.row]);
    data_.impulse[c.row] = flow.impulse;
    data_.moment[c.row] = flow.moment;
    data_.sticking[index] = 1;
    if (c.kind == RowKind::kSlider) {
      const double limit = rows_.friction[c.row] * h;
      data_.sticking[index] = std::abs(flow.impulse) <= limit;
      if (!data_.sticking[index]) {
        data_.impulse[c.row] = std::copysign(limit, flow.impulse);
        data_.moment[c.row] = 0.5 * h * data_.impulse[c.row];
      }
    }
    data_.recovery_input.constraint += data_.impulse[c.row] * surface;
  }

  void flow_friction(int index, const RowGroup& c) {
    double* impulse = data_.impulse.data() + c.row;
    double* moment = data_.moment.data() + c.row;
    std::fill(impulse + 1, impulse + c.dim, 0.0);
    std::fill(moment + 1, moment + c.dim, 0.0);
    data_.sticking[index] = 0;
    if (impulse[0] == 0.0) return;
    for (int i = 1; i < c.dim; ++i) {
      const int row = c.row + i;
      const Flow flow = flow_spring(law_of(rows_, row), data_.deformation[row], data_.rate[row],
                                    load(c, i), island_.duration, &data_.propagator[row]);
      impulse[i] = flow.impulse;
      moment[i] = flow.moment;
    }
    data_.sticking[index] = return_to_limit(rows_, c, impulse[0], impulse + 1);
    // A slipping contact carries mu f_n throughout, so its moments are in the normal's proportion.
    if (!data_.sticking[index])
      for (int i = 1; i < c.dim; ++i) moment[i] = impulse[i] * (moment[0] / impulse[0]);
  }

  // Springs follow the relative motion; the unstressed offset recovers; slipping springs carry
  // the limit.
  void deform(int index, const RowGroup& c) {
    const double h = island_.duration;
    const double recovered = offset_rate(data_.offset[index], recovery_speed_, h) * h;
    data_.offset[index] -= recovered;
    for (int i = 0; i < c.dim; ++i) {
      const int row = c.row + i;
      const bool slides = c.kind == RowKind::kSlider || i > 0;
      if (slides && !data_.sticking[index])
        data_.deformation[row] = -data_.impulse[row] / (rows_.stiffness[row] * h);
      else
        data_.deformation[row] +=
            gather(jacobian(c, i), c, data_.displacement.data()) - (i == 0 ? recovered : 0.0);
    }
  }

  const Rows& rows_;
  const Trees& trees_;
  const Island& island_;
  const double recovery_speed_;
  RowData& data_;
};

}  // namespace

void RowData::reset(const Rows& rows, int dofs) {
  const size_t row_count = rows.inverse_mass.size();
  const size_t contact_count = rows.group.size();
  for (auto* array : {&deformation, &rate, &force, &impulse, &moment, &total_impulse})
    array->assign(row_count, 0.0);
  propagator.assign(row_count, Propagator{});
  offset.assign(contact_count, 0.0);
  sticking.assign(contact_count, 0);
  touched.assign(contact_count, 0);
  for (auto* array :
       {&velocity, &smooth_acceleration, &displacement, &total_displacement, &acceleration})
    array->assign(dofs, 0.0);
  work = recovery_input = EnergyShares{};
}

void run_microsteps(const Rows& rows, const Trees& trees, const Island& island,
                    double recovery_speed, RowData& data) {
  Microstep microstep(rows, trees, island, recovery_speed, data);
  for (int i = 0; i < island.microsteps; ++i) {
    microstep.read_rates();
    microstep.apply_present_forces();
    microstep.flow();
    microstep.advance();
  }
  microstep.read_rates();
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
