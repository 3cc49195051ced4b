#include "dashpot/islands/contact_matching.hpp"

#include <algorithm>
#include <limits>

#include "dashpot/geometry/slots_by_pair.hpp"

namespace dashpot {

namespace {

constexpr int kContactsAtOnce = 64;  // by a thread

struct Nearest {
  int slot = -1;
  double squared_distance = std::numeric_limits<double>::infinity();  // m^2
};

// Kept by the thread from step to step: a step allocates nothing.
struct ContactMatching {
  const Memory* memory = nullptr;
  const ContactInput* contacts = nullptr;
  const Rows* rows = nullptr;
  Match* matches = nullptr;
  SlotsByPair slots;
  std::vector<Nearest> nearest;  // by group
  std::vector<int> heir;         // by slot: the group that goes on from it, -1: none
  std::vector<double> away;      // by slot: its squared distance

  const ContactInput& input_of(int group) const { return contacts[rows->group[group].input]; }

  // The nearest remembered point of the pair to which no other contact is nearer, -1 if there is
  // none; a point fixed to either geom is recognised by that geom.
  Nearest nearest_contact(const ContactInput& input) const {
    Nearest found;
    slots.for_each(pair_key(input.geom[0], input.geom[1]), [&](int slot) {
      const double distance =
          std::min(squared_distance(memory->position(slot, 0), input.local_position[0].data()),
                   squared_distance(memory->position(slot, 1), input.local_position[1].data()));
      if (distance < std::min(found.squared_distance, away[slot])) found = {slot, distance};
    });
    return found;
  }

  // Finds the load of a contact's pair, and its nearest point.
  void look(int group) {
    const ContactInput& input = input_of(group);
    double load = 0.0;
    bool hit = false;
    slots.for_each(pair_key(input.geom[0], input.geom[1]), [&](int slot) {
      load += memory->force(slot);
      hit = hit || input.gap < memory->parted_hit(slot);
    });
    matches[group].load = load;
    nearest[group] = input.gap < 0.0 || hit ? nearest_contact(input) : Nearest();
  }

  // Gives a group the nearest point that it may have; a group to which that is not as near looks
  // for another in its place.
  void inherit(int group) {
    while (group >= 0) {
      const ContactInput& input = input_of(group);
      Nearest& own = nearest[group];
      if (own.slot >= 0 && own.squared_distance >= away[own.slot])
        own = input.gap < 0.0 ? nearest_contact(input) : Nearest();
      const int slot = own.slot;
      if (slot < 0) return;
      const int former = heir[slot];
      heir[slot] = group;
      away[slot] = own.squared_distance;
      matches[group].nearest = slot;
      matches[group].parted = input.gap >= 0.0;
      if (former >= 0) matches[former] = {-1, false, matches[former].load};
      group = former;
    }
  }

  // What a geom rolls on to remembers what it left, by the place on that geom, geom 1 of both.
  void match_at_internal_edge(int group) {
    const ContactInput& input = input_of(group);
    if (matches[group].nearest >= 0 || !input.is_at_internal_edge() || input.gap >= 0.0) return;
    int& found = matches[group].nearest;
    double least = std::numeric_limits<double>::infinity();
    const auto visit = [&](int slot) {
      matches[group].load += memory->force(slot);
      const double distance =
          squared_distance(memory->position(slot, 0), input.local_position[0].data());
      if (heir[slot] >= 0 || distance >= least) return;
      least = distance;
      found = slot;
    };
    for (int other : input.ghosts)
      if (other >= 0) slots.for_each(pair_key(input.geom[0], other), visit);
    if (found >= 0) heir[found] = group;
  }
};

}  // namespace

void match_contacts(const Memory& memory, const std::vector<ContactInput>& contacts,
                    const Rows& rows, std::vector<Match>& matches, Team& team) {
  thread_local ContactMatching kept;
  ContactMatching& matching = kept;  // that of the calling thread, for all of the team
  const int slots = memory.contact_count(), groups = static_cast<int>(rows.group.size());
  matches.assign(groups, Match());
  matching.memory = &memory;
  matching.contacts = contacts.data();
  matching.rows = &rows;
  matching.matches = matches.data();
  matching.slots.reset(slots);
  for (int i = slots - 1; i >= 0; --i) {
    const auto [geom1, geom2] = memory.geoms(i);
    matching.slots.add(pair_key(geom1, geom2), i);
  }
  matching.heir.assign(slots, -1);
  matching.away.assign(slots, std::numeric_limits<double>::infinity());
  matching.nearest.resize(groups);
  const auto is_contact = [&](int i) { return rows.group[i].kind == RowKind::kContact; };
  team.for_each(groups, kContactsAtOnce, [&](int group) {
    if (is_contact(group)) matching.look(group);
  });
  bool any_at_internal_edge = false;
  for (int group = 0; group < groups; ++group) {
    if (!is_contact(group)) continue;
    const ContactInput& input = matching.input_of(group);
    any_at_internal_edge = any_at_internal_edge || input.is_at_internal_edge();
    const int nearest = matching.nearest[group].slot;
    if (nearest < 0) continue;
    if (input.gap >= 0.0 && input.gap >= memory.parted_hit(nearest)) continue;
    matching.inherit(group);
  }
  for (int group = 0; group < groups && any_at_internal_edge; ++group)
    if (is_contact(group)) matching.match_at_internal_edge(group);
}

}  // namespace dashpot
