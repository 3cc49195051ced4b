#include "dashpot/middle.hpp"

#include <algorithm>
#include <limits>

namespace dashpot {

namespace {

// Squared distance of two points on that geom of the pair on which they are nearer.
double squared_distance(const ContactInput& a, const ContactInput& b) {
  double nearest = std::numeric_limits<double>::infinity();
  for (int side = 0; side < 2; ++side) {
    double sum = 0.0;
    for (int i = 0; i < 3; ++i) {
      const double difference = a.local_position[side][i] - b.local_position[side][i];
      sum += difference * difference;
    }
    nearest = std::min(nearest, sum);
  }
  return nearest;
}

// Index of the contact of the same pair nearest to `contact`, -1 if there is none.
int nearest_of_pair(const ContactInput& contact, const std::vector<ContactInput>& contacts) {
  int nearest = -1;
  double least = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < contacts.size(); ++i) {
    if (contacts[i].geom != contact.geom) continue;
    const double distance = squared_distance(contact, contacts[i]);
    if (distance >= least) continue;
    least = distance;
    nearest = static_cast<int>(i);
  }
  return nearest;
}

}  // namespace

void take_gaps_at_start(const std::vector<ContactInput>& start, const std::vector<double>& way,
                        std::vector<ContactInput>& contacts) {
  for (size_t i = 0; i < contacts.size(); ++i) {
    const int same = nearest_of_pair(contacts[i], start);
    if (same < 0 || squared_distance(contacts[i], start[same]) > 4.0 * way[i] * way[i]) continue;
    if (nearest_of_pair(start[same], contacts) == static_cast<int>(i))
      contacts[i].gap = start[same].gap;
  }
}

}  // namespace dashpot
