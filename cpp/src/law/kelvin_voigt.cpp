// The closed-form flow of one Kelvin-Voigt contact: equations in kelvin_voigt.hpp.
//
// In contact, with a prime for d/dt,
//
//     f'' + w d f' + w k f = -k b,        f(t) = f0 E0 - (k u0 + d b) E1 - k b E2,
//     f'(t) = f1 E0 - k (b + w f0) E1,    f1 = f'(0) = -(k u0 + d b) - w d f0,
//
// so f' obeys the homogeneous equation and its zeros, the extrema of f, have a closed form. Extrema
// approach the resting force -b/w, the first minimum is the lowest, and between the first maximum
// and the first minimum f falls monotonically: the only release to look for is in there.
//
// Released but still overlapping (g < 0, -k g - d g' <= 0) the gap is a parabola, and so is the
// force that the spring-damper would have; contact returns where that parabola rises through 0.

#include "dashpot/law/kelvin_voigt.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dashpot/law/constants.hpp"

namespace dashpot {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();
constexpr double kEpsilon = std::numeric_limits<double>::epsilon();

// State and parameters of one contact phase, with the derivatives of its force at the start.
struct ContactPhase {
  double k, d, w, b;
  double f0;     // >= 0
  double drive;  // k u0 + d b
  double f1;     // f'(0)
  double q;      // -k (b + w f0): f' = f1 E0 + q E1

  ContactPhase(const KelvinVoigt& c, double rate, double load, double start_force)
      : k(c.stiffness),
        d(c.damping),
        w(c.inverse_mass),
        b(load),
        f0(start_force),
        drive(c.stiffness * rate + c.damping * load),
        f1(-drive - c.inverse_mass * c.damping * start_force),
        q(-c.stiffness * (load + c.inverse_mass * start_force)) {}

  double force(const Propagator& e) const { return f0 * e.e0 - drive * e.e1 - k * b * e.e2; }
  double force_rate(const Propagator& e) const { return f1 * e.e0 + q * e.e1; }
  double impulse(const Propagator& e) const { return f0 * e.e1 - drive * e.e2 - k * b * e.e3; }
  double moment(const Propagator& e) const { return f0 * e.e2 - drive * e.e3 - k * b * e.e4; }
};

// State at the end of a contact phase. Unlike g0 + u0 t + b t^2/2 + w r this does not cancel when a
// contact is held for many periods.
double gap_after(const KelvinVoigt& c, const Propagator& e, double g0, double u0, double b) {
  return g0 * (e.e0 + c.inverse_mass * c.damping * e.e1) + u0 * e.e1 + b * e.e2;
}

double rate_after(const KelvinVoigt& c, const Propagator& e, double g0, double u0, double b) {
  return u0 * e.e0 + (b - c.inverse_mass * c.stiffness * g0) * e.e1;
}

// True if f certainly stays >= 0 up to time t, where the propagator is e. Cheap: no root is sought.
bool holds(const ContactPhase& c, const Propagator& e, double t, double force_at_end) {
  if (force_at_end < 0.0) return false;
  const double square_frequency = c.w * c.k;
  // f'^2 + f''^2 / (w k) never grows, so |f'| <= B and f >= (f0 + f(t) - B t) / 2.
  const double f2 = c.q - c.w * c.d * c.f1;
  const double sum = c.f0 + force_at_end;
  if (sum * sum * square_frequency >= t * t * (c.f1 * c.f1 * square_frequency + f2 * f2))
    return true;
  // Within half a period f' has one zero at most: only a fall, then a rise has a minimum between.
  if (square_frequency * t * t >= kPi * kPi) return false;
  return c.f1 >= 0.0 || c.force_rate(e) <= 0.0;
}

// First t > 0 at which f' = 0, and the time from one zero of f' to the next (infinite unless the
// contact is underdamped). kNever if there is none.
struct Extremum {
  double first, spacing;
};

Extremum first_extremum(const ContactPhase& c) {
  if (c.f1 == 0.0 && c.q == 0.0) return {kNever, kNever};
  const Roots roots = characteristic_roots(c.w * c.d, c.w * c.k);
  if (roots.delta < 0.0) {
    const double omega = std::sqrt(-roots.delta);
    double angle = std::atan2(c.f1 * omega, roots.alpha * c.f1 - c.q);
    if (angle <= 0.0) angle += kPi;
    return {angle / omega, kPi / omega};
  }
  // f' is a sum of two exponentials, whose ratio at the zero is 1 + 2 beta f1 / rest.
  const double beta = std::sqrt(roots.delta);
  const double slow = roots.alpha > 0.0 ? c.w * c.k / (roots.alpha + beta) : 0.0;
  const double rest = slow * c.f1 - c.q;
  if (c.f1 == 0.0 || rest == 0.0 || (c.f1 > 0.0) != (rest > 0.0)) return {kNever, kNever};
  const double time =
      beta > 0.0 ? std::log1p(2.0 * beta * c.f1 / rest) / (2.0 * beta) : c.f1 / rest;
  return {time, kNever};
}

// First instant in (0, end] at which f falls through 0, or kNever. `force_at_end` = f(end).
double first_release(const ContactPhase& c, const KelvinVoigt& contact, double end,
                     double force_at_end) {
  const Extremum extremum = first_extremum(c);
  const bool rises = c.f1 > 0.0 || (c.f1 == 0.0 && c.q > 0.0);
  const double top = rises ? extremum.first : 0.0;
  if (top >= end) return kNever;
  const double bottom = std::min(end, rises ? top + extremum.spacing : extremum.first);
  const double lowest = bottom < end ? c.force(propagate(contact, bottom)) : force_at_end;
  if (lowest >= 0.0) return kNever;

  // f falls from >= 0 at `low` to < 0 at `high`: Newton, bisecting when it leaves the bracket or
  // does not halve its step. It starts from the parabola that osculates f at 0 if f falls there.
  double low = top, high = bottom;
  double t = 0.5 * (low + high);
  if (!rises) {
    const double f2 = c.q - c.w * c.d * c.f1;
    const double root = std::sqrt(std::max(0.0, c.f1 * c.f1 - 2.0 * c.f0 * f2));
    const double guess = 2.0 * c.f0 / (root - c.f1);
    if (guess > low && guess < high) t = guess;
  }
  double last_step = high - low;
  // Every two iterations halve the bracket or the step: 128 reach rounding from any bracket.
  for (int iteration = 0; iteration < 128; ++iteration) {
    const Propagator e = propagate(contact, t);
    const double f = c.force(e);
    (f >= 0.0 ? low : high) = t;
    double next = t - f / c.force_rate(e);
    if (!(next >= low && next <= high && std::fabs(next - t) <= 0.5 * last_step))
      next = 0.5 * (low + high);
    last_step = std::fabs(next - t);
    t = next;
    if (last_step <= kEpsilon * t) break;
  }
  return t;
}

// u^2 - 2 b g without cancellation (Kahan).
double discriminant(double u, double b, double g) {
  const double product = 2.0 * b * g;
  const double error = std::fma(2.0 * b, g, -product);
  return std::fma(u, u, -product) - error;
}

// When contact begins next, and how.
struct NextContact {
  double time = kNever;
  bool onset = false;  // from g > 0 at the rate -speed; otherwise the force rises from 0 at g < 0
  double speed = 0.0;
};

// From free flight, or from released overlap where the spring-damper would have a force <= 0.
NextContact next_contact(const KelvinVoigt& c, double g, double u, double b, double would_be) {
  NextContact next;
  const double disc = discriminant(u, b, g);
  if (g >= 0.0 || (u > 0.0 && disc >= 0.0)) {
    if (u >= 0.0 ? b >= 0.0 : disc <= 0.0) return next;
    next.onset = true;
    next.speed = std::sqrt(disc);
    next.time = u >= 0.0 ? (u + next.speed) / -b : 2.0 * g / (next.speed - u);
    return next;
  }
  // would_be + f1 t + f2 t^2/2 rises through 0.
  const double f1 = -(c.stiffness * u + c.damping * b);
  const double f2 = -c.stiffness * b;
  if (f2 < 0.0 || (f2 == 0.0 && f1 <= 0.0)) return next;
  const double root = std::sqrt(f1 * f1 - 2.0 * would_be * f2);
  next.time = f1 > 0.0 ? -2.0 * would_be / (f1 + root) : (root - f1) / f2;
  return next;
}

// A contact on its way through an interval, phase by phase.
struct Passage {
  const KelvinVoigt& contact;
  double b, time, remaining, g, u;
  double force = 0.0;  // at the start of a phase; if released, what the spring-damper would have
  bool in_contact = false;
  Flow flow{};

  void begin() {
    const double k = contact.stiffness, d = contact.damping;
    if (g < 0.0) {
      force = -k * g - d * u;
      const double f1 = -(k * u + d * b);
      in_contact = force > 0.0 || (force == 0.0 && (f1 > 0.0 || (f1 == 0.0 && k * b < 0.0)));
    } else if (g == 0.0 && (u < 0.0 || (u == 0.0 && b < 0.0))) {
      force = -d * u;
      in_contact = true;
    }
  }

  // Under a pressing load a contact of damping ratio <= 1 lasts at least 2/sqrt(w k) from onset and
  // pi/sqrt(w k) from a re-contact; one of larger damping ratio rebounds slower than exp(-2) times
  // its approach and rests after at most 710 rebounds even if its speed spans the whole range of
  // double. Under a pulling load or none contact never returns. A rebound makes three events.
  int max_events() const {
    const double square = contact.inverse_mass * contact.stiffness;
    return static_cast<int>(std::min(1e9, 3.0 * (712.0 + 0.5 * std::sqrt(square) * time)));
  }

  // In contact, until released; true at the interval's end. `given`: propagate() over the rest.
  bool press(const Propagator* given) {
    flow.touched = true;
    const ContactPhase phase(contact, u, b, force);
    Propagator e = given ? *given : propagate(contact, remaining);
    const double force_at_end = phase.force(e);
    double duration = remaining;
    bool released = false;
    if (!holds(phase, e, remaining, force_at_end) && flow.events < max_events()) {
      const double release = first_release(phase, contact, remaining, force_at_end);
      if (release <= remaining) {
        released = true;
        duration = release;
        e = propagate(contact, duration);
      }
    }
    const double p = std::max(0.0, phase.impulse(e));
    const double r = std::max(0.0, phase.moment(e));
    flow.moment += flow.impulse * duration + r;
    flow.impulse += p;
    const double end_gap = gap_after(contact, e, g, u, b);
    u = rate_after(contact, e, g, u, b);
    g = end_gap;
    remaining -= duration;
    force = 0.0;
    in_contact = false;
    if (released)
      ++flow.events;
    else
      flow.force = std::max(0.0, force_at_end);
    return !released;
  }

  // Apart, or in overlap without force, until contact begins.
  bool fly() {
    const NextContact next = next_contact(contact, g, u, b, force);
    const bool ends = !(next.time < remaining) || flow.events >= max_events();
    const double duration = ends ? remaining : next.time;
    flow.moment += flow.impulse * duration;
    if (!ends && next.onset) {
      g = 0.0;
      u = -next.speed;
      force = contact.damping * next.speed;
    } else {
      g += duration * (u + 0.5 * b * duration);
      u += b * duration;
      force = 0.0;
    }
    if (ends) return true;
    remaining -= duration;
    ++flow.events;
    in_contact = true;
    return false;
  }
};

}  // namespace

Flow flow_spring(const KelvinVoigt& spring, double displacement, double rate, double load,
                 double time, const Propagator* propagator) {
  const Propagator e = propagator ? *propagator : propagate(spring, time);
  const double force = -spring.stiffness * displacement - spring.damping * rate;
  const ContactPhase phase(spring, rate, load, force);
  Flow flow;
  flow.impulse = phase.impulse(e);
  flow.moment = phase.moment(e);
  flow.gap = gap_after(spring, e, displacement, rate, load);
  flow.rate = rate_after(spring, e, displacement, rate, load);
  flow.force = phase.force(e);
  flow.touched = true;
  return flow;
}

Flow flow_contact(const KelvinVoigt& contact, double gap, double rate, double load, double time,
                  const Propagator* propagator) {
  Passage passage{contact, load, time, time, gap, rate};
  passage.begin();
  while (!(passage.in_contact ? passage.press(propagator) : passage.fly())) propagator = nullptr;
  passage.flow.gap = passage.g;
  passage.flow.rate = passage.u;
  return passage.flow;
}

}  // namespace dashpot
