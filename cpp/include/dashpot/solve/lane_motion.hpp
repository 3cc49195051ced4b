// What a micro-step's motion changes in four groups of rows at once: rates, deformations,
// unstressed offsets, and the work of the rows.
//
// A slipping friction spring relaxes towards what the limit asks for, k s + d s' = -p/h.

#pragma once

#include <algorithm>

#include "dashpot/solve/contact_lanes.hpp"

namespace dashpot {

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

// How fast they shrink, m/s or rad/s: not at all where the spring is compressed beyond what is
// bearable, nor where the bodies have left it as far behind: a surface that comes after them would
// keep them in motion.
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

// What the turn of the geometry adds to the displacement over `time` (s) from the start of the step
// on.
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

// Springs that follow the motion get what the displacements of all micro-steps lack of that of the
// bodies.
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
