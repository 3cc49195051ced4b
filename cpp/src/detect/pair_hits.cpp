#include "pair_hits.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "dashpot/geometry/slots_by_pair.hpp"
#include "dashpot/model/properties.hpp"

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

namespace {

// The normal of a contact, out of what pushes into the tree on a side.
std::array<double, 3> into_side(const std::array<double, 3>& normal, int side) {
  if (side == 1) return normal;
  return {-normal[0], -normal[1], -normal[2]};
}

}  // namespace

IsolatedPairs::Chains& IsolatedPairs::chains() {
  thread_local Chains chains;
  return chains;
}

IsolatedPairs::IsolatedPairs(const mjModel_* m, const mjData_* d, const TurningStep& step,
                             const std::vector<ContactInput>& contacts)
    : model_(m), data_(d), step_(step), hit_speed_(kHitSpeed * metre(m)), chains_(chains()) {
  const Memory& memory = step.memory;
  auto& [pairs, first_of_tree, hits] = chains();
  hits.clear();
  for (int slot = 0; slot < memory.contact_count(); ++slot)
    if (memory.parted_hit(slot) > 0.0) hits.push_back({memory.geoms(slot), slot});
  std::sort(hits.begin(), hits.end(), [](const PastHit& a, const PastHit& b) {
    return a.geom != b.geom ? a.geom < b.geom : a.slot < b.slot;
  });
  pairs.clear();
  first_of_tree.assign(step.trees.tree.size(), -1);
  const ContactInput* const end = contacts.data() + contacts.size();
  for (const ContactInput *first = contacts.data(), *last = first; first != end; first = last) {
    last =
        std::find_if(first, end, [&](const ContactInput& c) { return !c.is_of_pair(first->geom); });
    Pair pair{first->tree,
              {-1, -1},
              {first->frame[0], first->frame[1], first->frame[2]},
              onset(first, last)};
    for (int side = 0; side < 2; ++side) {
      const int tree = first->tree[side];
      if (tree < 0 || (side == 0 && tree == first->tree[1])) continue;
      pair.next[side] = first_of_tree[tree];
      first_of_tree[tree] = static_cast<int>(pairs.size());
    }
    pairs.push_back(pair);
  }
}

bool IsolatedPairs::is_alone(const ContactInput& contact, double deepest) const {
  const std::array<double, 3> normal{contact.frame[0], contact.frame[1], contact.frame[2]};
  for (int side = 0; side < 2; ++side) {
    const int tree = contact.tree[side];
    if (tree < 0) continue;
    for (int i = chains_.first_of_tree[tree]; i >= 0;) {
      const Pair& pair = chains_.pairs[i];
      const int side_of_other = pair.tree[1] == tree;
      if (!joins_same_trees(contact.tree, pair.tree) &&
          disturbs_hit(pair.onset, into_side(pair.normal, side_of_other), into_side(normal, side),
                       deepest))
        return false;
      i = pair.next[side_of_other];
    }
  }
  return true;
}

double IsolatedPairs::compression(const ContactInput& contact) const {
  const auto comes_before = [](const PastHit& hit, const std::array<int, 2>& geom) {
    return hit.geom < geom;
  };
  double nearest = std::numeric_limits<double>::infinity(), compression = 0.0;
  for (auto hit =
           std::lower_bound(chains_.hits.begin(), chains_.hits.end(), contact.geom, comes_before);
       hit != chains_.hits.end() && hit->geom == contact.geom; ++hit) {
    const double distance = dashpot::squared_distance(step_.memory.position(hit->slot, 0),
                                                      contact.local_position[0].data());
    if (distance >= nearest) continue;
    nearest = distance;
    compression = step_.memory.parted_hit(hit->slot);
  }
  return compression;
}

// When the first gap of a pair closes (s), infinite if none does in the step.
double IsolatedPairs::onset(const ContactInput* first, const ContactInput* last) const {
  ContactMotion motion(model_, data_, step_.length);
  if (std::any_of(first, last, [](const ContactInput& c) { return c.gap <= 0.0; }) ||
      !motion.find(*first, step_))
    return 0.0;
  double least = std::numeric_limits<double>::infinity();
  for (const ContactInput* c = first; c != last; ++c)
    least = std::min(least, onset_in(step_.length, c->gap, -motion.gap_rate(*c)));
  return least;
}

}  // namespace dashpot::host
