// The contact law on four groups of rows at once over a micro-step of length h.
//
// Between events it is that of kelvin_voigt.hpp and friction.hpp. A lane whose normal meets an
// event (onset, release, re-contact) inside the micro-step is handed to flow_contact.

#pragma once

#include <algorithm>

#include "dashpot/law/friction.hpp"
#include "dashpot/solve/contact_lanes.hpp"

namespace dashpot {

// s of microstep.hpp.
inline constexpr double kCoupledShare = 1.0 / 3.0;

// What the limit surface of friction goes by: the impulse or force of the normal, less than it
// where friction falls with load. `duration` is that of an impulse, 1 for a force.
template <int Dim>
[[gnu::always_inline]] static inline Lanes find_pressure(const ContactLanes<Dim>& c,
                                                         const Lanes& normal, double duration) {
  const Lanes zero{}, one = all_lanes(1.0);
  if (!c.load_dependent) return normal;
  const Lanes load = max_lanes(normal, zero) * c.inverse_friction_load / duration;
  return normal * (c.loaded_friction + (one - c.loaded_friction) / (one + load));
}

// The lanes in which nothing slips: friction, behind the normal one, is inside the limit surface.
// Sets friction to zero in lanes without pressure.
template <int Dim>
[[gnu::always_inline]] static inline LaneMask find_sticking(const ContactLanes<Dim>& c,
                                                            Lanes* impulse, const Lanes& pressure) {
  const Lanes zero{};
  Lanes square{};
  for (int i = 1; i < Dim; ++i) {
    impulse[i] = select(impulse[0] > zero, impulse[i], zero);
    const Lanes z = impulse[i] * c.inverse_friction[i - 1];
    square += z * z;
  }
  return square <= pressure * pressure;
}

// Returns friction impulses or forces to the limit surface in the lanes that are not `sticking`:
// return_to_limit of friction.hpp.
template <int Dim>
[[gnu::always_inline]] static inline void return_friction(const ContactLanes<Dim>& c,
                                                          Lanes* impulse, const Lanes& pressure,
                                                          const LaneMask& sticking) {
  const Lanes zero{}, one = all_lanes(1.0);
  const Lanes inverse_normal = one / select(impulse[0] > zero, pressure, one);
  Lanes z[Dim], gamma{}, shrink[Dim];
  for (int i = 1; i < Dim; ++i) z[i] = impulse[i] * c.inverse_friction[i - 1] * inverse_normal;
  for (int round = 0;; ++round) {
    Lanes slope{}, square{};
    for (int i = 1; i < Dim; ++i) {
      shrink[i] = one / (one + gamma * c.slip[i - 1]);
      const Lanes q = z[i] * shrink[i];
      square += q * q;
      slope += q * q * c.slip[i - 1] * shrink[i];
    }
    const Lanes length = root_lanes(square);
    // The next gamma is infinite where a direction that does not respond is beyond the surface.
    const Lanes next = gamma + (length - one) * square / select(slope > zero, slope, one);
    const LaneMask outside =
        ~sticking & (length - one > zero + kOnSurface) & (slope > zero) & (next - next == zero);
    if (round == kMaxRounds || !any_of(outside)) {
      for (int i = 1; i < Dim; ++i) {
        const Lanes returned = impulse[i] * shrink[i] * select(length > one, one / length, one);
        impulse[i] = select(sticking, impulse[i], returned);
      }
      return;
    }
    gamma = select(outside, next, gamma);
  }
}

// Turns slipping friction, whose spring and damper may point in different directions, to the
// impulse of the micro-step to come, under the load that it bears now: the forces of a slip that
// goes on do not change, and other rows must not take them for changing ones.
template <int Dim>
[[gnu::always_inline]] static inline void turn_slipping_force(ContactLanes<Dim>& c,
                                                              const Lanes& pressure,
                                                              const LaneMask& sticking) {
  const Lanes zero{}, one = all_lanes(1.0);
  Lanes square{}, square_to_come{}, to_come[Dim];
  for (int i = 1; i < Dim; ++i) {
    const Lanes z = c.force[i] * c.inverse_friction[i - 1];
    square += z * z;
  }
  const Lanes on_surface = pressure / root_lanes(select(sticking, one, square));
  for (int i = 1; i < Dim; ++i) {
    const SpringCoefficients& spring = c.spring[i - 1];
    const Lanes load = -c.inverse_mass[i] * c.force[i] * on_surface;
    to_come[i] = spring.impulse_displacement * c.deformation[i] + spring.impulse_rate * c.rate[i] +
                 spring.impulse_load * load;
    const Lanes z = to_come[i] * c.inverse_friction[i - 1];
    square_to_come += z * z;
  }
  const LaneMask turns = ~sticking & (square_to_come > zero);
  const Lanes scale = root_lanes(square / select(turns, square_to_come, one));
  for (int i = 1; i < Dim; ++i) c.force[i] = select(turns, to_come[i] * scale, c.force[i]);
}

// The force every contact has now; no number where anything it depends on is none.
template <int Dim>
[[gnu::always_inline]] static inline void find_present_force(ContactLanes<Dim>& c) {
  const Lanes zero{};
  for (int i = 0; i < Dim; ++i)
    c.force[i] = -c.stiffness[i] * c.deformation[i] - c.damping[i] * c.rate[i];
  c.force[0] = max_lanes(zero, c.force[0] + c.damping[0] * c.surface);
  c.force[0] = select(c.deformation[0] >= zero, zero, c.force[0]);
  if (Dim == 1) return;
  const Lanes pressure = find_pressure(c, c.force[0], 1.0);
  const LaneMask sticking = find_sticking(c, c.force, pressure);
  if (all_of(sticking)) return;
  turn_slipping_force(c, pressure, sticking);
  return_friction(c, c.force, pressure, sticking);
}

// The same for a spring behind a slider.
[[gnu::always_inline]] static inline void find_present_force(SpringLanes& c) {
  const Lanes force = -c.stiffness[0] * c.deformation[0] - c.damping[0] * c.rate[0];
  c.force[0] = min_lanes(c.limit, max_lanes(-c.limit, force));
}

// One lane through all its events.
template <int Dim>
static void flow_lane(ContactLanes<Dim>& c, int lane, double rate, double load, double h,
                      Lanes& moment) {
  const KelvinVoigt law{c.stiffness[0][lane], c.damping[0][lane], c.inverse_mass[0][lane]};
  const Propagator e{c.e[0][lane], c.e[1][lane], c.e[2][lane], c.e[3][lane], c.e[4][lane]};
  const Flow flow = flow_contact(law, c.deformation[0][lane], rate, load, h, &e);
  c.impulse[0][lane] = flow.impulse;
  moment[lane] = flow.moment;
}

// Impulse and moment of the normals: closed form where contact lasts throughout, nothing where it
// stays open, event by event elsewhere.
template <int Dim>
[[gnu::always_inline]] static inline void flow_normal(ContactLanes<Dim>& c, const Lanes& load,
                                                      double h, Lanes& moment) {
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
  c.impulse[0] = select(holds, impulse, zero);
  moment = select(holds, moment, zero);
  const LaneMask closed_form = holds | open;
  if (!all_of(closed_form))
    for (int lane = 0; lane < kLanes; ++lane)
      if (!closed_form[lane]) flow_lane(c, lane, u[lane], load[lane], h, moment);
  c.recovery_input += c.impulse[0] * c.surface;
}

// Impulse and moment of a spring-damper row.
template <int Dim>
[[gnu::always_inline]] static inline void flow_spring(RowLanes<Dim>& c, int i,
                                                      const SpringCoefficients& spring,
                                                      const Lanes& load, Lanes& moment) {
  const Lanes x = c.deformation[i], rate = c.rate[i];
  c.impulse[i] =
      spring.impulse_displacement * x + spring.impulse_rate * rate + spring.impulse_load * load;
  moment = spring.moment_displacement * x + spring.impulse_load * rate + spring.moment_load * load;
}

// The sums of impulses and of their moments, and of the displacement of every row all but the part
// that goes by the rate it will have then: h u + h^2/2 b + w r - s h (u + h b + w p).
template <int Dim>
[[gnu::always_inline]] static inline void end_flow(RowLanes<Dim>& c, const Lanes* load,
                                                   const Lanes* moment, double h) {
  for (int i = 0; i < Dim; ++i) {
    c.total_impulse[i] += c.impulse[i];
    c.total_moment[i] += moment[i];
    const Lanes rate = c.rate[i] + h * load[i] + c.inverse_mass[i] * c.impulse[i];
    c.displacement[i] = h * (c.rate[i] + 0.5 * h * load[i]) + c.inverse_mass[i] * moment[i] -
                        kCoupledShare * h * rate;
  }
}

// Flow over h under `motion`, the acceleration of every row with all present forces; a row's own
// force is left out of its load. `moment`: of every row's impulse.
template <int Dim>
[[gnu::always_inline]] static inline void flow(ContactLanes<Dim>& c, const Lanes* motion, double h,
                                               Lanes* moment) {
  const Lanes zero{};
  Lanes load[Dim];
  for (int i = 0; i < Dim; ++i) load[i] = motion[i] - c.inverse_mass[i] * c.force[i];
  if (c.turns)
    for (int i = 0; i < std::min(Dim, 3); ++i) load[i] += c.turning[i];
  flow_normal(c, load[0], h, moment[0]);
  if (Dim > 1) {
    for (int i = 1; i < Dim; ++i) flow_spring(c, i, c.spring[i - 1], load[i], moment[i]);
    const Lanes pressure = find_pressure(c, c.impulse[0], h);
    const LaneMask inside = find_sticking(c, c.impulse, pressure);
    if (!all_of(inside)) return_friction(c, c.impulse, pressure, inside);
    const LaneMask pressed = c.impulse[0] > zero;
    c.sticking = inside & pressed;
    // A slipping contact carries mu f_n throughout, so its moments are in the normal's proportion.
    if (!all_of(c.sticking)) {
      const Lanes lever = moment[0] / select(pressed, c.impulse[0], all_lanes(1.0));
      for (int i = 1; i < Dim; ++i) {
        const Lanes sticks_or_slips = select(inside, moment[i], c.impulse[i] * lever);
        moment[i] = select(pressed, sticks_or_slips, zero);
      }
    }
  }
  end_flow(c, load, moment, h);
}

[[gnu::always_inline]] static inline void flow(SpringLanes& c, const Lanes* motion, double h,
                                               Lanes* moment) {
  const Lanes zero{}, load = motion[0] - c.inverse_mass[0] * c.force[0];
  flow_spring(c, 0, c.spring, load, moment[0]);
  const Lanes limit = c.limit * h;
  const Lanes clamped = min_lanes(max_lanes(c.impulse[0], -limit), limit);
  c.sticking = clamped == c.impulse[0];
  c.impulse[0] = clamped;
  moment[0] = select(c.sticking, moment[0], 0.5 * h * clamped);
  c.touched |= c.impulse[0] != zero;
  end_flow(c, &load, moment, h);
}

}  // namespace dashpot
