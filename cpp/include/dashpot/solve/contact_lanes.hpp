// Four groups of rows at once, one in each lane, over micro-steps of length h: their parameters,
// their state, and what depends on parameters and h alone, which is computed once. The law is in
// lane_flow.hpp, and how motion changes the state below.
//
// Row 0 of a contact is its normal (or a limit); the others are friction.

#pragma once

#include <algorithm>

#include "dashpot/lanes/lanes.hpp"
#include "dashpot/law/kelvin_voigt.hpp"

namespace dashpot {

// p and r of a spring-damper, linear in displacement, rate and load; fixed during micro-steps.
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
  Lanes displacement[Dim];  // by the row's own flow, but for its end, see end_flow()
  Lanes total_impulse[Dim], total_moment[Dim], total_displacement[Dim];
  Lanes bearable;        // deformation under which the unstressed penetration recovers
  Lanes recovery_speed;  // at most, m/s or rad/s
  Lanes unstressed, surface;
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
  Lanes turning_work;                            // J: impulses times what `turning` adds to rates
  Lanes lever[Dim < 3 ? Dim : 3];                // N s^2: impulses times the time since `ahead`
  Lanes ahead;                                   // of RowGroup
  Lanes drift;                                   // m/s, of RowData
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
[[gnu::always_inline]] static inline void propagate(const RowLanes<Dim>& c, int i, double h,
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
[[gnu::always_inline]] static inline void prepare_spring(const RowLanes<Dim>& c, int i, double h,
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
  const Lanes zero{}, one = all_lanes(1.0);
  relaxation.compliance_h = select(k > zero, one / (select(k > zero, k, one) * h), zero);
}

// What depends on parameters and h alone.
template <int Dim>
[[gnu::always_inline]] static inline void prepare(ContactLanes<Dim>& c, double h) {
  propagate(c, 0, h, c.e);
  Lanes largest{};
  for (int i = 1; i < Dim; ++i) {
    prepare_spring(c, i, h, c.spring[i - 1], c.relaxation[i - 1]);
    const Lanes response = -c.spring[i - 1].impulse_rate;
    c.slip[i - 1] = response * c.inverse_friction[i - 1] * c.inverse_friction[i - 1];
    largest = max_lanes(largest, c.slip[i - 1]);
  }
  const LaneMask responds = largest > Lanes{};
  const Lanes scale = select(responds, largest, all_lanes(1.0));
  for (int i = 1; i < Dim; ++i) c.slip[i - 1] = select(responds, c.slip[i - 1] / scale, Lanes{});
}

[[gnu::always_inline]] static inline void prepare(SpringLanes& c, double h) {
  prepare_spring(c, 0, h, c.spring, c.relaxation);
}

// What a micro-step's motion changes in four groups of rows at once: rates, deformations,
// unstressed offsets, and the work of the rows.
//
// A slipping friction spring relaxes towards what the limit asks for, k s + d s' = -p/h.
//
// How unstressed offsets shrink: by the fraction 1 / `time` (s) of theirs, at most at a speed.
struct Recovery {
  double time = 0.0;
};

// What recovers within one step leaves bodies with a speed that has nothing to do with their
// motion: corners of a round mesh that land 5 um deep kept it rolling.
inline constexpr double kRecoverySteps = 2.0;
inline constexpr double kLeastRecoveryTime = 0.01;  // s
inline Recovery recovery_over(double step) {
  return {std::max(kLeastRecoveryTime, kRecoverySteps * step)};
}

// How fast they shrink, m/s or rad/s: not where the spring is compressed beyond what is bearable,
// nor where bodies have left it as far behind: a surface that follows would keep them in motion.
template <int Dim>
[[gnu::always_inline]] static inline Lanes offset_rate(const RowLanes<Dim>& c,
                                                       const Recovery& recovery) {
  const Lanes zero{};
  const Lanes rate = min_lanes(c.unstressed / recovery.time, c.recovery_speed);
  const Lanes x = c.deformation[0];
  const LaneMask stays = (c.unstressed <= zero) | (x * x > c.bearable * c.bearable);
  return select(stays, zero, rate);
}

// An impulse p with moment r does the work p (u0 + u1) / 2 + b (h p / 2 - r) under the load b of
// everything but the rows, which is the same in all micro-steps: here the first term of the last
// impulses, which changed the rates to `rate`.
template <int Dim>
[[gnu::always_inline]] static inline void account_motion(RowLanes<Dim>& c, int i,
                                                         const Lanes& rate) {
  c.work[i > 0] += 0.5 * c.impulse[i] * (c.rate[i] + rate);
  c.rate[i] = rate;
}

// What the turn of its geometry adds to a contact's rates at `rate_time` (s) from the start of the
// step on: less than those of the frozen geometry before the time that this is of, and more after
// it, and the drift. It is no motion of bodies, so no work is booked of it. `work_time` (s): the
// mean time of the last impulses.
template <int Dim>
[[gnu::always_inline]] static inline void turn_rows(ContactLanes<Dim>& c, double rate_time,
                                                    double work_time, Lanes* rate) {
  for (int i = 0; i < std::min(Dim, 3); ++i) {
    const Lanes drift = i == 0 ? c.drift : Lanes{};
    rate[i] += c.turning[i] * (rate_time - c.ahead) + drift;
    const Lanes work = c.impulse[i] * (c.turning[i] * (work_time - c.ahead) + drift);
    c.work[i > 0] -= work;
    c.turning_work += work;
    c.lever[i] += c.impulse[i] * (work_time - c.ahead);
  }
}

// What the turn of geometry adds to the displacement over `time` (s) from the start of the step.
template <int Dim>
[[gnu::always_inline]] static inline void turn_displacement(const ContactLanes<Dim>& c, double time,
                                                            Lanes* displacement) {
  for (int i = 0; i < std::min(Dim, 3); ++i)
    displacement[i] += c.turning[i] * (time * (0.5 * time - c.ahead));
  displacement[0] += c.drift * time;
}

// Books the second term of the work, of all micro-steps together. `load`: of every row.
template <int Dim>
[[gnu::always_inline]] static inline void account_load(RowLanes<Dim>& c, const Lanes* load,
                                                       double h) {
  for (int i = 0; i < Dim; ++i)
    c.work[i > 0] += load[i] * (0.5 * h * c.total_impulse[i] - c.total_moment[i]);
}

[[gnu::always_inline]] static inline Lanes relax(const RelaxationCoefficients& spring,
                                                 const Lanes& impulse, const Lanes& deformation) {
  const Lanes limit = -impulse * spring.compliance_h;
  return limit + spring.relaxation * (deformation - limit);
}

// The displacement of every row in the last micro-step, `coupled_time` (s) times the rate that it
// ended with being the last part of it.
template <int Dim>
[[gnu::always_inline]] static inline void end_displacement(RowLanes<Dim>& c, const Lanes* rate,
                                                           double coupled_time,
                                                           Lanes* displacement) {
  for (int i = 0; i < Dim; ++i) {
    displacement[i] = c.displacement[i] + coupled_time * rate[i];
    c.total_displacement[i] += displacement[i];
  }
}

// Rates, work and deformations after the motion of a micro-step: springs follow the relative
// motion, unstressed offsets recover, springs behind slipping sliders relax.
template <int Dim>
[[gnu::always_inline]] static inline void read_motion(ContactLanes<Dim>& c, const Lanes* rate,
                                                      double h, double coupled_time,
                                                      const Recovery& recovery) {
  Lanes displacement[Dim];
  end_displacement(c, rate, coupled_time, displacement);
  const Lanes recovered = h * c.surface;
  c.unstressed -= recovered;
  c.deformation[0] += displacement[0] - recovered;
  if (all_of(c.sticking)) {
    for (int i = 1; i < Dim; ++i) c.deformation[i] += displacement[i];
  } else {
    for (int i = 1; i < Dim; ++i) {
      const Lanes relaxed = relax(c.relaxation[i - 1], c.impulse[i], c.deformation[i]);
      c.deformation[i] = select(c.sticking, c.deformation[i] + displacement[i], relaxed);
    }
  }
  for (int i = 0; i < Dim; ++i) account_motion(c, i, rate[i]);
  c.surface = offset_rate(c, recovery);
}

// The offsets of equalities are recovered by displacement (position_recovery.hpp).
[[gnu::always_inline]] static inline void read_motion(SpringLanes& c, const Lanes* rate,
                                                      double /*h*/, double coupled_time,
                                                      const Recovery& /*recovery*/) {
  Lanes displacement[1];
  end_displacement(c, rate, coupled_time, displacement);
  const Lanes relaxed = relax(c.relaxation, c.impulse[0], c.deformation[0]);
  c.deformation[0] = select(c.sticking, c.deformation[0] + displacement[0], relaxed);
  account_motion(c, 0, rate[0]);
}

// Springs that follow the motion get what displacements of micro-steps lack of that of the bodies.
template <int Dim>
[[gnu::always_inline]] static inline void follow_bodies(ContactLanes<Dim>& c,
                                                        const Lanes* displacement) {
  c.deformation[0] += displacement[0] - c.total_displacement[0];
  for (int i = 1; i < Dim; ++i)
    c.deformation[i] += select(c.sticking, displacement[i] - c.total_displacement[i], Lanes{});
}

[[gnu::always_inline]] static inline void follow_bodies(SpringLanes& c, const Lanes* displacement) {
  c.deformation[0] += select(c.sticking, displacement[0] - c.total_displacement[0], Lanes{});
}

}  // namespace dashpot
