#include "dashpot/detection/seams.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>

#include "dashpot/detection/seam_handovers.hpp"
#include "dashpot/detection/seam_passes.hpp"
#include "dashpot/mujoco/properties.hpp"

namespace dashpot::host {

namespace {

// Notes on the contacts of a pair that its geom on `side` bears the other one up to a seam.
void mark_continued(size_t index, int side, std::vector<ContactInput>& contacts) {
  const std::array<int, 2> pair = contacts[index].geom;
  while (index > 0 && contacts[index - 1].is_of_pair(pair)) --index;
  for (; index < contacts.size() && contacts[index].is_of_pair(pair); ++index)
    contacts[index].continued = side;
}

}  // namespace

void drop_contacts_at_seams(const mjModel_* m, const mjData_* d,
                            const std::vector<double>& start_reach, FaceBuffers& faces,
                            SeamBuffers& buffers, std::vector<ContactInput>& contacts) {
  const auto moves = [&](const ContactInput& c) {
    return !c.is_of_flex() && start_reach[c.geom[0]] + start_reach[c.geom[1]] >
                                  std::max(c.gap, kSeamMotion * contact_radius(m, c));
  };
  const auto is_of_round_geom = [&](const ContactInput& c) { return may_roll_over_a_seam(m, c); };
  if (std::none_of(contacts.begin(), contacts.end(), moves) &&
      std::none_of(contacts.begin(), contacts.end(), is_of_round_geom))
    return;
  const Bearers bearers(m, d, start_reach, buffers.bearers, contacts);
  // Those to be dropped are found before any is: each may be what another body rests on.
  std::vector<char>& at_seam = buffers.at_seam;
  at_seam.assign(contacts.size(), 0);
  SeamPasses passes(m, d, bearers, faces);
  for (size_t i = 0; i < contacts.size(); ++i) {
    if (!moves(contacts[i])) continue;
    const ContactSide before = passes.before_seam(contacts[i]);
    if (before.index < 0) continue;
    at_seam[i] = 1;
    mark_continued(before.index, 1 - before.side, contacts);
  }
  SeamHandovers handovers(m, d, bearers, faces, contacts);
  // Contacts of a pair come one after the other.
  for (size_t first = 0, last; first < contacts.size(); first = last) {
    last = first + 1;
    while (last < contacts.size() && contacts[last].is_of_pair(contacts[first].geom)) ++last;
    handovers.hand_over(first, last, buffers.successor, at_seam);
  }
  size_t kept = 0;
  for (size_t i = 0; i < contacts.size(); ++i)
    if (!at_seam[i]) {
      if (kept != i) contacts[kept] = contacts[i];
      ++kept;
    }
  contacts.resize(kept);
}

}  // namespace dashpot::host
