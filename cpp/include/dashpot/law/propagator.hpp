// The propagator E_0 ... E_4 of a spring and damper.
//
// With stiffness k, damping d and apparent inverse mass w, E_n solves for n >= 2
//
//     y'' + w d y' + w k y = t^(n-2)/(n-2)!,    y(0) = y'(0) = 0,
//
// and E1 = E2', E0 = E1'. The E_n are entire in (w k, w d, t): smooth through critical damping and
// accurate as w k t^2 goes to 0. E_n = t^n exp[0,...,0, z1, z2] is the divided difference of the
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

// Characteristic roots: -alpha +- sqrt(delta), or -alpha +- i omega.
struct Roots {
  double alpha;  // w d / 2
  double delta;  // alpha^2 - w k
};
Roots characteristic_roots(double damping_rate, double square_frequency);

}  // namespace dashpot
