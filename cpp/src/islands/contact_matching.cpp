#include "dashpot/islands/contact_matching.hpp"

#include <algorithm>
#include <limits>

#include "dashpot/geometry/squared_distance.hpp"

namespace dashpot {

namespace {

constexpr int kContactsAtOnce = 64;  // by a thread

}  // namespace

void ContactMatching::find(const Memory& memory, const std::vector<ContactInput>& contacts,
                           const Rows& rows, std::vector<Match>& matches, Team& team) {
  const int slots = memory.contact_count(), groups = static_cast<int>(rows.group.size());
  matches.assign(groups, Match());
  slots_.reset(slots);
  for (int i = slots - 1; i >= 0; --i) {
    const auto [geom1, geom2] = memory.geoms(i);
    slots_.add(pair_key(geom1, geom2), i);
  }
  // By remembered point: the group that is nearest to it. Another one near it is a new point: a
  // compression that two inherit would be two springs as deep.
  heir_.assign(slots, -1);
  away_.assign(slots, std::numeric_limits<double>::infinity());
  nearest_.resize(groups);
  team.for_each(groups, kContactsAtOnce, [&](int index) {
    const RowGroup& c = rows.group[index];
    if (c.kind != RowKind::kContact) return;
    const ContactInput& input = contacts[c.input];
    double load = 0.0;
    bool hit = false;
    slots_.for_each(pair_key(input.geom[0], input.geom[1]), [&](int slot) {
      load += memory.force(slot);
      hit = hit || input.gap < memory.parted_hit(slot);
    });
    matches[index].load = load;
    nearest_[index] = Nearest();
    if (input.gap < 0.0 || hit) nearest_[index] = nearest_contact(memory, input);
  });
  bool any_at_seam = false;
  for (int index = 0; index < groups; ++index) {
    const RowGroup& c = rows.group[index];
    if (c.kind != RowKind::kContact) continue;
    const ContactInput& input = contacts[c.input];
    any_at_seam = any_at_seam || input.is_at_seam();
    const auto [nearest, away] = nearest_[index];
    if (nearest < 0 || !(away < away_[nearest])) continue;
    if (input.gap >= 0.0 && input.gap >= memory.parted_hit(nearest)) continue;
    if (heir_[nearest] >= 0) matches[heir_[nearest]].nearest = -1;
    heir_[nearest] = index;
    away_[nearest] = away;
    matches[index].nearest = nearest;
    matches[index].parted = input.gap >= 0.0;
  }
  if (any_at_seam) match_at_seams(memory, contacts, rows, matches);
}

// The nearest remembered point of the pair, -1 if there is none; a point fixed to either geom is
// recognised by that geom.
ContactMatching::Nearest ContactMatching::nearest_contact(const Memory& memory,
                                                          const ContactInput& input) const {
  Nearest nearest;
  slots_.for_each(pair_key(input.geom[0], input.geom[1]), [&](int slot) {
    const double distance =
        std::min(squared_distance(memory.position(slot, 0), input.local_position[0].data()),
                 squared_distance(memory.position(slot, 1), input.local_position[1].data()));
    if (distance < nearest.squared_distance) nearest = {slot, distance};
  });
  return nearest;
}

// What a geom rolls on to remembers what it left, by the place on that geom, geom 1 of both.
void ContactMatching::match_at_seams(const Memory& memory,
                                     const std::vector<ContactInput>& contacts, const Rows& rows,
                                     std::vector<Match>& matches) {
  for (size_t index = 0; index < rows.group.size(); ++index) {
    const RowGroup& c = rows.group[index];
    if (c.kind != RowKind::kContact || matches[index].nearest >= 0) continue;
    const ContactInput& input = contacts[c.input];
    if (!input.is_at_seam() || input.gap >= 0.0) continue;
    int& nearest = matches[index].nearest;
    double least = std::numeric_limits<double>::infinity();
    const auto visit = [&](int slot) {
      matches[index].load += memory.force(slot);
      const double away =
          squared_distance(memory.position(slot, 0), input.local_position[0].data());
      if (heir_[slot] >= 0 || away >= least) return;
      least = away;
      nearest = slot;
    };
    for (int other : input.takes_over)
      if (other >= 0) slots_.for_each(pair_key(input.geom[0], other), visit);
    if (nearest >= 0) heir_[nearest] = static_cast<int>(index);
  }
}

}  // namespace dashpot
