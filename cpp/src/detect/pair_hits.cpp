#include "pair_hits.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace dashpot::host {

// A gap (m) closes at a speed (m/s), and has an acceleration (m/s^2).
double PairHits::onset(double gap, double closing, double acceleration) const {
  if (gap <= 0.0) return 0.0;
  const double square = closing * closing - 2.0 * acceleration * gap;
  if (closing <= 0.0 || square <= 0.0) return step_.length;
  return std::min(step_.length, 2.0 * gap / (closing + std::sqrt(square)));
}

double PairHits::onset(const ContactInput& contact) const {
  return onset(contact.gap, -motion_.gap_rate(contact), 0.0);
}

double PairHits::compression(const ContactInput& contact) const {
  const double compressed = motion_.are_round() ? pairs_.compression(contact) : 0.0;
  return compressed > 0.0 && is_soft(contact) ? compressed : 0.0;
}

double PairHits::frequency(const ContactInput& contact) const {
  const double rate = motion_.gap_rate(contact), begins = onset(contact);
  const double compressed = compression(contact);
  if ((std::abs(rate) < pairs_.hit_speed() && compressed == 0.0) || begins == step_.length)
    return 0.0;
  const double inverse_mass = motion_.inverse_mass(contact, step_.trees);
  if (inverse_mass == 0.0) return 0.0;
  const double frequency = step_.frequency(contact, inverse_mass);
  if (std::hypot(rate, frequency * compressed) < pairs_.hit_speed()) return 0.0;
  if (!motion_.are_round() && frequency * step_.length < kShortHit) return 0.0;
  return pairs_.is_alone(contact, deepest_of_hit(begins, frequency)) ? frequency : 0.0;
}

bool PairHits::is_soft(const ContactInput& contact) const {
  return step_.frequency(contact, motion_.inverse_mass(contact, step_.trees)) <
         step_.frequency(contact, std::numeric_limits<double>::infinity());
}

// Only round bodies turn evenly: of others another corner may come to be the nearest.
double PairHits::time(const ContactInput& contact, double frequency, double acceleration,
                      double otherwise) const {
  const double closing = -motion_.gap_rate(contact), gap = contact.gap;
  const double begins = onset(gap, closing, acceleration), left = step_.length - begins;
  if (left == 0.0) return otherwise;
  const double remembered = compression(contact);
  const double compressed = remembered > 0.0 ? remembered : std::max(0.0, -gap);
  const double opens = motion_.are_round() ? acceleration : 0.0;
  return begins +
         centre_of_hit(frequency, compressed, closing - acceleration * begins, opens, left);
}

// Of a spring that swings it is the swing that counts, about the place where it bears the turn.
bool PairHits::rolls(const ContactInput& contact, double frequency, double rate,
                     double acceleration) const {
  const double compressed = compression(contact);
  if (compressed == 0.0)
    return std::abs(rate) <
           std::max(pairs_.hit_speed(), 2.0 * step_.length * std::abs(acceleration));
  const double borne = acceleration / frequency;
  return std::hypot(rate, frequency * compressed + borne) <
         std::max(pairs_.hit_speed(), std::abs(borne));
}

}  // namespace dashpot::host
