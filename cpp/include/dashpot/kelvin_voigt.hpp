// Closed-form flow of one Kelvin-Voigt contact and of one bilateral spring-damper.
//
// Gap g (m, negative in penetration), gap rate u = g' (m/s), apparent inverse mass w (1/kg),
// acceleration b (m/s^2) of the gap from everything but this contact's own force:
//
//     g'' = b + w f,      f = max(0, -k g - d g')   while g < 0,   else 0.
//
// In contact the force is linear, so with f0 = -k g0 - d u0
//
//     p(t) = int f        = f0 E1(t) - (k u0 + d b) E2(t) - k b E3(t)
//     r(t) = int int f    = f0 E2(t) - (k u0 + d b) E3(t) - k b E4(t)
//     u(t) = u0 + b t + w p(t),      g(t) = g0 + u0 t + b t^2/2 + w r(t)
//
// where E_n solves y'' + w d y' + w k y = t^(n-2)/(n-2)!, y(0) = y'(0) = 0 (n >= 2),
// E1 = E2', E0 = E1'. The E_n are entire in (w k, w d, t): smooth through critical damping and
// accurate as w k t^2 -> 0. E_n = t^n exp[0,...,0, z1, z2] is the divided difference of the
// exponential at n-1 zeros and the two characteristic roots z = lambda t.

#pragma once

namespace dashpot {

// Contact parameters in SI units.
struct KelvinVoigt {
  double stiffness = 0.0;     // k, N/m, >= 0
  double damping = 0.0;       // d, N s/m, >= 0
  double inverse_mass = 0.0;  // w, 1/kg, > 0
};

// E0..E4 at one time. They depend on parameters and time only, so a row that stays in contact
// computes them once per micro-step size.
struct Propagator {
  double e0 = 1.0, e1 = 0.0, e2 = 0.0, e3 = 0.0, e4 = 0.0;
};

// 1/n!, n = 0..31.
struct InverseFactorials {
  double value[32];
  constexpr InverseFactorials() : value() {
    double factorial = 1.0;
    for (int n = 0; n < 32; ++n) {
      value[n] = 1.0 / factorial;
      factorial *= n + 1;
    }
  }
};
inline constexpr InverseFactorials kInverseFactorial;

// Whether the power series of the propagator is used, with a = w d t and b = w k t^2: both roots,
// times t, within radius 2 of the origin. Terms for 1e-17 there, and within the unit circle.
constexpr bool has_series(double a, double b) {
  return a <= 4.0 && b <= 4.0 && (a * a < 4.0 * b || 4.0 - 2.0 * a + b >= 0.0);
}
inline constexpr int kSeriesTerms = 26;
inline constexpr int kUnitTerms = 18;

// Evaluates the propagator at `time` >= 0. Relative error <= 1e-13 on e2..e4, for w k t^2 up to 1e8
// and damping ratio up to 20, plus what rounding of w k costs the phase: 4e-16 sqrt(w k) t. Where
// damping ratio < 0.1, e2 nearly vanishes once a period; its error then is relative to 2/(w k).
Propagator propagate(const KelvinVoigt& contact, double time);

// What a flow over an interval returns.
struct Flow {
  double impulse = 0.0;  // p = int f dt, N s; >= 0 for a contact
  double moment = 0.0;   // r = int int f dt dt, N s^2; position changes by w r
  double gap = 0.0;      // g at the end, m
  double rate = 0.0;     // u at the end, m/s
  double force = 0.0;    // f at the end, N
  bool touched = false;  // force acted at some instant of the interval
  int events = 0;        // onsets, releases and re-contacts solved inside the interval
};

// Unilateral contact over `time` (s, > 0) from gap (m), rate (m/s) under load b (m/s^2). Every
// onset, release and re-contact inside the interval is solved. `propagator`, if given, is
// propagate(contact, time); it saves work when the contact holds over the whole interval.
Flow flow_contact(const KelvinVoigt& contact, double gap, double rate, double load, double time,
                  const Propagator* propagator = nullptr);

// Bilateral spring-damper over the same interval: f = -k x - d x' of either sign, no events.
Flow flow_spring(const KelvinVoigt& spring, double displacement, double rate, double load,
                 double time, const Propagator* propagator = nullptr);

// The flow of a bilateral spring-damper is linear in displacement, rate and load:
//     p = impulse . (x, u, b),    r = moment . (x, u, b) .
// Rows that flow at one micro-step size compute the coefficients once.
struct LinearFlow {
  double impulse[3] = {0.0, 0.0, 0.0};
  double moment[3] = {0.0, 0.0, 0.0};
};
inline LinearFlow linear_flow(const KelvinVoigt& spring, const Propagator& e) {
  const double k = spring.stiffness, d = spring.damping;
  return {{-k * e.e1, -d * e.e1 - k * e.e2, -d * e.e2 - k * e.e3},
          {-k * e.e2, -d * e.e2 - k * e.e3, -d * e.e3 - k * e.e4}};
}

}  // namespace dashpot
