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
// with the propagator E_n of propagator.hpp.

#pragma once

#include "dashpot/law/propagator.hpp"

namespace dashpot {

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

}  // namespace dashpot
