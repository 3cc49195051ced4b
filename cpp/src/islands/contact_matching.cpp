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
  bool any_at_internal_edge = false;
  for (int index = 0; index < groups; ++index) {
    const RowGroup& c = rows.group[index];
    if (c.kind != RowKind::kContact) continue;
    const ContactInput& input = contacts[c.input];
    any_at_internal_edge = any_at_internal_edge || input.is_at_internal_edge();
    const int nearest = nearest_[index].slot;
    if (nearest < 0) continue;
    if (input.gap >= 0.0 && input.gap >= memory.parted_hit(nearest)) continue;
    inherit(memory, contacts, rows, index, matches);
  }
  if (any_at_internal_edge) match_at_internal_edges(memory, contacts, rows, matches);
}

// The nearest remembered point of the pair to which no other contact is nearer, -1 if there is
// none; a point fixed to either geom is recognised by that geom.
ContactMatching::Nearest ContactMatching::nearest_contact(const Memory& memory,
                                                          const ContactInput& input) const {
  Nearest nearest;
  slots_.for_each(pair_key(input.geom[0], input.geom[1]), [&](int slot) {
    const double distance =
        std::min(squared_distance(memory.position(slot, 0), input.local_position[0].data()),
                 squared_distance(memory.position(slot, 1), input.local_position[1].data()));
    if (distance < std::min(nearest.squared_distance, away_[slot])) nearest = {slot, distance};
  });
  return nearest;
}

// Gives a group the nearest point that it may have; a group to which that is not as near looks for
// another in its place.
void ContactMatching::inherit(const Memory& memory, const std::vector<ContactInput>& contacts,
                              const Rows& rows, int group, std::vector<Match>& matches) {
  while (group >= 0) {
    const ContactInput& input = contacts[rows.group[group].input];
    Nearest& nearest = nearest_[group];
    if (nearest.slot >= 0 && nearest.squared_distance >= away_[nearest.slot])
      nearest = input.gap < 0.0 ? nearest_contact(memory, input) : Nearest();
    const int slot = nearest.slot;
    if (slot < 0) return;
    const int former = heir_[slot];
    heir_[slot] = group;
    away_[slot] = nearest.squared_distance;
    matches[group].nearest = slot;
    matches[group].parted = input.gap >= 0.0;
    if (former >= 0) matches[former] = {-1, false, matches[former].load};
    group = former;
  }
}

// What a geom rolls on to remembers what it left, by the place on that geom, geom 1 of both.
void ContactMatching::match_at_internal_edges(const Memory& memory,
                                              const std::vector<ContactInput>& contacts,
                                              const Rows& rows, std::vector<Match>& matches) {
  for (size_t index = 0; index < rows.group.size(); ++index) {
    const RowGroup& c = rows.group[index];
    if (c.kind != RowKind::kContact || matches[index].nearest >= 0) continue;
    const ContactInput& input = contacts[c.input];
    if (!input.is_at_internal_edge() || input.gap >= 0.0) continue;
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
    for (int other : input.ghosts)
      if (other >= 0) slots_.for_each(pair_key(input.geom[0], other), visit);
    if (nearest >= 0) heir_[nearest] = static_cast<int>(index);
  }
}

}  // namespace dashpot
