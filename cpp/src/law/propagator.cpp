#include "dashpot/law/propagator.hpp"

#include <cmath>

namespace dashpot {
namespace {

// Power series E_n = t^n sum_j h_j / (n + j)!, where h_j are the complete homogeneous symmetric
// polynomials of the two roots: h_j = -(w d t) h_(j-1) - (w k t^2) h_(j-2). E2, E1, E0 follow from
// the differential equation E_(n-2) + w d E_(n-1) + w k E_n = t^(n-2)/(n-2)!.
Propagator propagate_by_series(double damping_rate, double square_frequency, double t) {
  const double a = -damping_rate * t;
  const double b = -square_frequency * t * t;
  const int terms = (1.0 + a + b >= 0.0) ? kUnitTerms : kSeriesTerms;
  double before = 0.0, h = 1.0, sum3 = 0.0, sum4 = 0.0;
  for (int j = 0; j < terms; ++j) {
    sum3 += h * kInverseFactorial.value[j + 3];
    sum4 += h * kInverseFactorial.value[j + 4];
    const double next = a * h + b * before;
    before = h;
    h = next;
  }
  Propagator e;
  const double t2 = t * t;
  e.e4 = t2 * t2 * sum4;
  e.e3 = t2 * t * sum3;
  e.e2 = 0.5 * t2 - damping_rate * e.e3 - square_frequency * e.e4;
  e.e1 = t - damping_rate * e.e2 - square_frequency * e.e3;
  e.e0 = 1.0 - damping_rate * e.e1 - square_frequency * e.e2;
  return e;
}

// phi_0 = exp, phi_(n+1)(z) = (phi_n(z) - 1/n!) / z for real z <= 0.
struct Phi {
  double phi0, phi1, phi2, phi3;
};

Phi evaluate_phi(double z) {
  if (z > -1.0) {
    double phi3 = kInverseFactorial.value[20];
    for (int n = 19; n >= 3; --n) phi3 = phi3 * z + kInverseFactorial.value[n];
    const double phi2 = 0.5 + z * phi3;
    const double phi1 = 1.0 + z * phi2;
    return {1.0 + z * phi1, phi1, phi2, phi3};
  }
  const double phi1 = std::expm1(z) / z;
  const double phi2 = (phi1 - 1.0) / z;
  return {std::exp(z), phi1, phi2, (phi2 - 0.5) / z};
}

// Two well separated real roots: divided differences of phi.
Propagator propagate_overdamped(const Roots& roots, double square_frequency, double t) {
  const double beta = std::sqrt(roots.delta);
  const double fast = -(roots.alpha + beta) * t;
  const double slow = -square_frequency / (roots.alpha + beta) * t;
  const Phi x = evaluate_phi(slow), y = evaluate_phi(fast);
  const double scale = 1.0 / (slow - fast);
  const double t2 = t * t;
  Propagator e;
  e.e0 = (slow * x.phi0 - fast * y.phi0) * scale;
  e.e1 = t * (x.phi0 - y.phi0) * scale;
  e.e2 = t2 * (x.phi1 - y.phi1) * scale;
  e.e3 = t2 * t * (x.phi2 - y.phi2) * scale;
  e.e4 = t2 * t2 * (x.phi3 - y.phi3) * scale;
  return e;
}

// Complex, equal or close real roots of a time long enough for the recurrence in n.
Propagator propagate_oscillating(const Roots& roots, double damping_rate, double square_frequency,
                                 double t) {
  double cosine, sine;  // e^(-alpha t) cos(omega t) and e^(-alpha t) sin(omega t) / (omega t)
  const double x = std::sqrt(std::fabs(roots.delta)) * t;
  if (roots.delta < 0.0) {
    const double decay = std::exp(-roots.alpha * t);
    cosine = decay * std::cos(x);
    sine = x > 0.0 ? decay * std::sin(x) / x : decay;
  } else {
    const double decay = std::exp(-square_frequency * t / (roots.alpha + std::sqrt(roots.delta)));
    const double loss = std::expm1(-2.0 * x);
    cosine = decay * (1.0 + 0.5 * loss);
    sine = x > 0.0 ? decay * loss / (-2.0 * x) : decay;
  }
  Propagator e;
  e.e1 = t * sine;
  e.e0 = cosine - roots.alpha * e.e1;
  e.e2 = (1.0 - e.e0 - damping_rate * e.e1) / square_frequency;
  e.e3 = (t - e.e1 - damping_rate * e.e2) / square_frequency;
  e.e4 = (0.5 * t * t - e.e2 - damping_rate * e.e3) / square_frequency;
  return e;
}

}  // namespace

Roots characteristic_roots(double damping_rate, double square_frequency) {
  const double alpha = 0.5 * damping_rate;
  const double frequency = std::sqrt(square_frequency);
  return {alpha, (alpha - frequency) * (alpha + frequency)};
}

Propagator propagate(const KelvinVoigt& contact, double time) {
  const double damping_rate = contact.inverse_mass * contact.damping;
  const double square_frequency = contact.inverse_mass * contact.stiffness;
  const double a = damping_rate * time;
  const double b = square_frequency * time * time;
  if (has_series(a, b)) return propagate_by_series(damping_rate, square_frequency, time);
  const Roots roots = characteristic_roots(damping_rate, square_frequency);
  // Real roots whose ratio exceeds 2.4 (zeta^2 > 1.2) lose less than a digit in a difference.
  if (roots.alpha * roots.alpha > 1.2 * square_frequency)
    return propagate_overdamped(roots, square_frequency, time);
  return propagate_oscillating(roots, damping_rate, square_frequency, time);
}

}  // namespace dashpot
