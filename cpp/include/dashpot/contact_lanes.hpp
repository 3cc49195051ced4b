// The contact law on four groups of rows at once, one in each lane, over micro-steps of length h.
//
// Between events the law is that of kelvin_voigt.hpp and friction.hpp, with everything that depends
// on parameters and h alone computed once. A lane whose normal meets an event (onset, release,
// re-contact) inside the micro-step is handed to flow_contact.
//
// Row 0 of a contact is its normal (or a limit); the others are friction. A slipping friction
// spring relaxes towards what the limit asks for, k s + d s' = -p/h.

#pragma once

#include <algorithm>
#include <array>

#include "dashpot/friction.hpp"
#include "dashpot/kelvin_voigt.hpp"
#include "dashpot/lanes.hpp"

namespace dashpot {

// p and r of a spring-damper are linear in displacement, rate and load (LinearFlow). Fixed during
// an island's micro-steps.
struct SpringCoefficients {
  Lanes impulse_displacement, impulse_rate;
  Lanes impulse_load;  // and moment_rate
  Lanes moment_displacement, moment_load;
};

// Behind a slipping slider the displacement of a spring relaxes.
struct RelaxationCoefficients {
  Lanes relaxation;    // exp(-k h / d)
  Lanes compliance_h;  // 1 / (k h)
};

// The rows of four groups. Members as in Rows and RowData. Large islands stream through the cache
// in every sweep, so what a sweep does not need is not stored, and what is needed where something
// slips is stored last.
template <int Dim>
struct RowLanes {
  Lanes stiffness[Dim], damping[Dim], inverse_mass[Dim];
  Lanes deformation[Dim], rate[Dim], force[Dim], impulse[Dim];
  Lanes total_impulse[Dim], total_moment[Dim];
  Lanes bearable;  // deformation under which the offset recovers
  Lanes offset, surface;
  LaneMask sticking;
  Lanes work[2];         // of row 0 and of the others, J
  Lanes recovery_input;  // J
};

template <int Dim>
struct ContactLanes : RowLanes<Dim> {
  static constexpr int kFrictionRows = Dim > 1 ? Dim - 1 : 1;
  Lanes e[5];  // propagator of the normal over h
  // Of row i + 1. 1/mu is 0 where mu = 0, and such a row has no stiffness, damping or impulse.
  SpringCoefficients spring[kFrictionRows];
  Lanes inverse_friction[kFrictionRows];
  bool load_dependent = false;  // s < 1 in any lane
  bool turns = false;           // any of `turning` is not 0
  RelaxationCoefficients relaxation[kFrictionRows];
  Lanes slip[kFrictionRows];  // c / mu^2 of friction.hpp, the largest of a contact being 1
  Lanes loaded_friction, inverse_friction_load;  // s and 1 / F of friction.hpp
  Lanes turning[Dim < 3 ? Dim : 3];              // of RowGroup
};

// A spring-damper of either sign whose force is at most `limit`: infinite for an equality.
struct SpringLanes : RowLanes<1> {
  SpringCoefficients spring;
  RelaxationCoefficients relaxation;
  LaneMask touched;
  Lanes limit;         // N or N m
  Lanes force_moment;  // about the start of the step, N s^2 or N m s^2
};

// propagate() of row i over h, four at a time where all have a series.
template <int Dim>
[[gnu::always_inline]] inline void propagate(const RowLanes<Dim>& c, int i, double h,
                                             Lanes (&e)[5]) {
  const Lanes damping_rate = c.inverse_mass[i] * c.damping[i];
  const Lanes square_frequency = c.inverse_mass[i] * c.stiffness[i];
  const Lanes a = -damping_rate * h, b = -square_frequency * (h * h);
  bool series = true, unit = true;
  for (int lane = 0; lane < kLanes; ++lane) {
    series = series && has_series(-a[lane], -b[lane]);
    unit = unit && 1.0 + a[lane] + b[lane] >= 0.0;
  }
  if (!series) {
    for (int lane = 0; lane < kLanes; ++lane) {
      const Propagator at =
          propagate({c.stiffness[i][lane], c.damping[i][lane], c.inverse_mass[i][lane]}, h);
      e[0][lane] = at.e0;
      e[1][lane] = at.e1;
      e[2][lane] = at.e2;
      e[3][lane] = at.e3;
      e[4][lane] = at.e4;
    }
    return;
  }
  Lanes before{}, term = all_lanes(1.0), sum3{}, sum4{};
  for (int j = 0; j < (unit ? kUnitTerms : kSeriesTerms); ++j) {
    sum3 += term * kInverseFactorial.value[j + 3];
    sum4 += term * kInverseFactorial.value[j + 4];
    const Lanes next = a * term + b * before;
    before = term;
    term = next;
  }
  e[4] = (h * h * h * h) * sum4;
  e[3] = (h * h * h) * sum3;
  e[2] = 0.5 * h * h - damping_rate * e[3] - square_frequency * e[4];
  e[1] = h - damping_rate * e[2] - square_frequency * e[3];
  e[0] = 1.0 - damping_rate * e[1] - square_frequency * e[2];
}

// The coefficients of row i; exp(-k h / d) is given.
template <int Dim>
[[gnu::always_inline]] inline void prepare_spring(const RowLanes<Dim>& c, int i, double h,
                                                  SpringCoefficients& spring,
                                                  RelaxationCoefficients& relaxation) {
  Lanes e[5];
  propagate(c, i, h, e);
  const Lanes k = c.stiffness[i], d = c.damping[i];
  spring.impulse_displacement = -k * e[1];
  spring.impulse_rate = -d * e[1] - k * e[2];
  spring.impulse_load = -d * e[2] - k * e[3];
  spring.moment_displacement = -k * e[2];
  spring.moment_load = -d * e[3] - k * e[4];
  const Lanes one = all_lanes(1.0);
  relaxation.compliance_h = k > Lanes{} ? one / ((k > Lanes{} ? k : one) * h) : Lanes{};
}

// What depends on parameters and h alone.
template <int Dim>
[[gnu::always_inline]] inline void prepare(ContactLanes<Dim>& c, double h) {
  propagate(c, 0, h, c.e);
  Lanes largest{};
  for (int i = 1; i < Dim; ++i) {
    prepare_spring(c, i, h, c.spring[i - 1], c.relaxation[i - 1]);
    const Lanes response = -c.spring[i - 1].impulse_rate;
    c.slip[i - 1] = response * c.inverse_friction[i - 1] * c.inverse_friction[i - 1];
    largest = max_lanes(largest, c.slip[i - 1]);
  }
  for (int i = 1; i < Dim; ++i)
    c.slip[i - 1] = largest > Lanes{}
                        ? c.slip[i - 1] / (largest > Lanes{} ? largest : all_lanes(1.0))
                        : Lanes{};
}

[[gnu::always_inline]] inline void prepare(SpringLanes& c, double h) {
  prepare_spring(c, 0, h, c.spring, c.relaxation);
}

// How fast unstressed offsets shrink, m/s or rad/s: not at all where the spring is compressed
// beyond what is bearable, nor where the bodies have left it as far behind: a surface that comes
// after them would keep them in motion.
template <int Dim>
[[gnu::always_inline]] inline Lanes offset_rate(const RowLanes<Dim>& c, double h,
                                                double recovery_speed) {
  const Lanes speed = all_lanes(recovery_speed), zero{};
  const Lanes rate = min_lanes(c.offset / h, speed);
  const Lanes x = c.deformation[0];
  return (c.offset <= zero) | (x * x > c.bearable * c.bearable) ? zero : rate;
}

// An impulse p with moment r does the work p (u0 + u1) / 2 + b (h p / 2 - r) under the load b of
// everything but the rows, which is the same in all micro-steps: here the first term of the last
// impulses, which changed the rates to `rate`.
template <int Dim>
[[gnu::always_inline]] inline void account_motion(RowLanes<Dim>& c, int i, const Lanes& rate) {
  c.work[i > 0] += 0.5 * c.impulse[i] * (c.rate[i] + rate);
  c.rate[i] = rate;
}

// What the turn of its geometry adds to a contact's rates and displacements: `rate_time` (s) times
// its acceleration, and `displacement_time` (s^2) times it. The first half of a step takes from the
// rates, and the second adds: no motion of bodies, so no work is booked of it. `work_time` (s): its
// mean time during the last impulses.
template <int Dim>
[[gnu::always_inline]] inline void turn_rows(ContactLanes<Dim>& c, double rate_time,
                                             double displacement_time, double work_time,
                                             Lanes* rate, Lanes* displacement) {
  for (int i = 0; i < std::min(Dim, 3); ++i) {
    rate[i] += c.turning[i] * rate_time;
    displacement[i] += c.turning[i] * displacement_time;
    c.work[i > 0] -= c.impulse[i] * c.turning[i] * work_time;
  }
}

// The second term, of all micro-steps. `load`: of every row.
template <int Dim>
[[gnu::always_inline]] inline void account_load(RowLanes<Dim>& c, const Lanes* load, double h) {
  for (int i = 0; i < Dim; ++i)
    c.work[i > 0] += load[i] * (0.5 * h * c.total_impulse[i] - c.total_moment[i]);
}

[[gnu::always_inline]] inline Lanes relax(const RelaxationCoefficients& spring,
                                          const Lanes& impulse, const Lanes& deformation) {
  const Lanes limit = -impulse * spring.compliance_h;
  return limit + spring.relaxation * (deformation - limit);
}

// Rates, work and deformations after the motion of a micro-step: springs follow the relative
// motion, unstressed offsets recover, springs behind slipping sliders relax.
template <int Dim>
[[gnu::always_inline]] inline void read_motion(ContactLanes<Dim>& c, const Lanes* rate,
                                               const Lanes* displacement, double h,
                                               double recovery_speed) {
  const Lanes recovered = h * c.surface;
  c.offset -= recovered;
  c.deformation[0] += displacement[0] - recovered;
  if (all_of(c.sticking)) {
    for (int i = 1; i < Dim; ++i) c.deformation[i] += displacement[i];
  } else {
    for (int i = 1; i < Dim; ++i) {
      const Lanes relaxed = relax(c.relaxation[i - 1], c.impulse[i], c.deformation[i]);
      c.deformation[i] = c.sticking ? c.deformation[i] + displacement[i] : relaxed;
    }
  }
  for (int i = 0; i < Dim; ++i) account_motion(c, i, rate[i]);
  c.surface = offset_rate(c, h, recovery_speed);
}

// The offsets of equalities are recovered by displacement (position_recovery.hpp).
[[gnu::always_inline]] inline void read_motion(SpringLanes& c, const Lanes* rate,
                                               const Lanes* displacement, double /*h*/,
                                               double /*recovery_speed*/) {
  const Lanes relaxed = relax(c.relaxation, c.impulse[0], c.deformation[0]);
  c.deformation[0] = c.sticking ? c.deformation[0] + displacement[0] : relaxed;
  account_motion(c, 0, rate[0]);
}

// Returns friction impulses or forces, behind the normal one, to the limit surface: return_to_limit
// of friction.hpp. `inside`: the lanes in which nothing slips. `duration` is that of an impulse, 1
// for forces. Lanes without pressure carry nothing.
template <int Dim>
[[gnu::always_inline]] inline void return_friction(const ContactLanes<Dim>& c, Lanes* impulse,
                                                   LaneMask& inside, double duration) {
  const Lanes zero{}, one = all_lanes(1.0);
  const LaneMask pressed = impulse[0] > zero;
  Lanes pressure = impulse[0];
  if (c.load_dependent) {
    const Lanes load = max_lanes(impulse[0], zero) * c.inverse_friction_load / duration;
    pressure *= c.loaded_friction + (one - c.loaded_friction) / (one + load);
  }
  Lanes z[Dim], square{};
  for (int i = 1; i < Dim; ++i) {
    impulse[i] = pressed ? impulse[i] : zero;
    z[i] = impulse[i] * c.inverse_friction[i - 1];
    square += z[i] * z[i];
  }
  inside = square <= pressure * pressure;
  if (all_of(inside)) return;
  const Lanes inverse_normal = one / (pressed ? pressure : one);
  Lanes gamma{}, shrink[Dim];
  for (int i = 1; i < Dim; ++i) z[i] *= inverse_normal;
  for (int round = 0;; ++round) {
    Lanes slope{};
    square = zero;
    for (int i = 1; i < Dim; ++i) {
      shrink[i] = one / (one + gamma * c.slip[i - 1]);
      const Lanes q = z[i] * shrink[i];
      square += q * q;
      slope += q * q * c.slip[i - 1] * shrink[i];
    }
    const Lanes length = root_lanes(square);
    // The next gamma is infinite where a direction that does not respond is beyond the surface.
    const Lanes next = gamma + (length - one) * square / (slope > zero ? slope : one);
    const LaneMask outside =
        ~inside & (length - one > zero + kOnSurface) & (slope > zero) & (next - next == zero);
    if (round == kMaxRounds || !any_of(outside)) {
      for (int i = 1; i < Dim; ++i) {
        const Lanes returned = impulse[i] * shrink[i] * (length > one ? one / length : one);
        impulse[i] = inside ? impulse[i] : returned;
      }
      return;
    }
    gamma = outside ? next : gamma;
  }
}

// The force every contact has now; no number where anything it depends on is none.
template <int Dim>
[[gnu::always_inline]] inline void find_present_force(ContactLanes<Dim>& c) {
  const Lanes zero{};
  for (int i = 0; i < Dim; ++i)
    c.force[i] = -c.stiffness[i] * c.deformation[i] - c.damping[i] * c.rate[i];
  c.force[0] = max_lanes(zero, c.force[0] + c.damping[0] * c.surface);
  c.force[0] = c.deformation[0] >= zero ? zero : c.force[0];
  LaneMask inside;
  if (Dim > 1) return_friction(c, c.force, inside, 1.0);
}

// The same for a spring behind a slider.
[[gnu::always_inline]] inline void find_present_force(SpringLanes& c) {
  const Lanes force = -c.stiffness[0] * c.deformation[0] - c.damping[0] * c.rate[0];
  c.force[0] = min_lanes(c.limit, max_lanes(-c.limit, force));
}

// One lane through all its events.
template <int Dim>
void flow_lane(ContactLanes<Dim>& c, int lane, double rate, double load, double h, Lanes& moment) {
  const KelvinVoigt law{c.stiffness[0][lane], c.damping[0][lane], c.inverse_mass[0][lane]};
  const Propagator e{c.e[0][lane], c.e[1][lane], c.e[2][lane], c.e[3][lane], c.e[4][lane]};
  const Flow flow = flow_contact(law, c.deformation[0][lane], rate, load, h, &e);
  c.impulse[0][lane] = flow.impulse;
  moment[lane] = flow.moment;
}

// Impulse and moment of the normals: closed form where contact lasts throughout, nothing where it
// stays open, event by event elsewhere.
template <int Dim>
[[gnu::always_inline]] inline void flow_normal(ContactLanes<Dim>& c, const Lanes& load, double h,
                                               Lanes& moment) {
  constexpr double kSquaredPi = 9.869604401089358;
  const Lanes zero{};
  const Lanes k = c.stiffness[0], d = c.damping[0], w = c.inverse_mass[0];
  const Lanes x = c.deformation[0], u = c.rate[0] - c.surface;
  // The force f = f0 E0 - drive E1 - k b E2, its rates, and what bounds it (kelvin_voigt.cpp).
  const Lanes f0 = -k * x - d * u;
  const Lanes drive = k * u + d * load;
  const Lanes f1 = -drive - w * d * f0;
  const Lanes q = -k * (load + w * f0);
  const Lanes f2 = q - w * d * f1;
  const Lanes end = f0 * c.e[0] - drive * c.e[1] - k * load * c.e[2];
  const Lanes end_rate = f1 * c.e[0] + q * c.e[1];
  const Lanes square_frequency = w * k;
  const Lanes sum = f0 + end;
  const LaneMask far_from_zero =
      sum * sum * square_frequency >= h * h * (f1 * f1 * square_frequency + f2 * f2);
  const LaneMask one_minimum =
      (square_frequency * (h * h) < kSquaredPi - zero) & ((f1 >= zero) | (end_rate <= zero));
  const LaneMask holds = (x < zero) & (f0 > zero) & (end >= zero) & (far_from_zero | one_minimum);
  const LaneMask open = x + h * min_lanes(zero, min_lanes(u, u + h * load)) > zero;
  const Lanes impulse = max_lanes(f0 * c.e[1] - drive * c.e[2] - k * load * c.e[3], zero);
  moment = max_lanes(f0 * c.e[2] - drive * c.e[3] - k * load * c.e[4], zero);
  c.impulse[0] = holds ? impulse : zero;
  moment = holds ? moment : zero;
  const LaneMask closed_form = holds | open;
  if (!all_of(closed_form))
    for (int lane = 0; lane < kLanes; ++lane)
      if (!closed_form[lane]) flow_lane(c, lane, u[lane], load[lane], h, moment);
  c.recovery_input += c.impulse[0] * c.surface;
}

// Impulse and moment of a spring-damper row.
template <int Dim>
[[gnu::always_inline]] inline void flow_spring(RowLanes<Dim>& c, int i,
                                               const SpringCoefficients& spring, const Lanes& load,
                                               Lanes& moment) {
  const Lanes x = c.deformation[i], rate = c.rate[i];
  c.impulse[i] =
      spring.impulse_displacement * x + spring.impulse_rate * rate + spring.impulse_load * load;
  moment = spring.moment_displacement * x + spring.impulse_load * rate + spring.moment_load * load;
}

// The sums of impulses and of their moments.
template <int Dim>
[[gnu::always_inline]] inline void add_totals(RowLanes<Dim>& c, const Lanes* moment) {
  for (int i = 0; i < Dim; ++i) {
    c.total_impulse[i] += c.impulse[i];
    c.total_moment[i] += moment[i];
  }
}

// Flow over h under `motion`, the acceleration of every row with all present forces; a row's own
// force is left out of its load. `moment`: of every row's impulse.
template <int Dim>
[[gnu::always_inline]] inline void flow(ContactLanes<Dim>& c, const Lanes* motion, double h,
                                        Lanes* moment) {
  const Lanes zero{};
  Lanes load[Dim];
  for (int i = 0; i < Dim; ++i) load[i] = motion[i] - c.inverse_mass[i] * c.force[i];
  if (c.turns)
    for (int i = 0; i < std::min(Dim, 3); ++i) load[i] += c.turning[i];
  flow_normal(c, load[0], h, moment[0]);
  if (Dim > 1) {
    for (int i = 1; i < Dim; ++i) flow_spring(c, i, c.spring[i - 1], load[i], moment[i]);
    LaneMask inside;
    return_friction(c, c.impulse, inside, h);
    const LaneMask pressed = c.impulse[0] > zero;
    c.sticking = inside & pressed;
    // A slipping contact carries mu f_n throughout, so its moments are in the normal's proportion.
    if (!all_of(c.sticking)) {
      const Lanes lever = moment[0] / (pressed ? c.impulse[0] : all_lanes(1.0));
      for (int i = 1; i < Dim; ++i) {
        const Lanes sticks_or_slips = inside ? moment[i] : c.impulse[i] * lever;
        moment[i] = pressed ? sticks_or_slips : zero;
      }
    }
  }
  add_totals(c, moment);
}

[[gnu::always_inline]] inline void flow(SpringLanes& c, const Lanes* motion, double h,
                                        Lanes* moment) {
  const Lanes zero{};
  flow_spring(c, 0, c.spring, motion[0] - c.inverse_mass[0] * c.force[0], moment[0]);
  const Lanes limit = c.limit * h;
  const Lanes clamped = min_lanes(max_lanes(c.impulse[0], -limit), limit);
  c.sticking = clamped == c.impulse[0];
  c.impulse[0] = clamped;
  moment[0] = c.sticking ? moment[0] : 0.5 * h * clamped;
  c.touched |= c.impulse[0] != zero;
  add_totals(c, moment);
}

}  // namespace dashpot
