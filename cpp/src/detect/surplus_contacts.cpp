#include "dashpot/detect/surplus_contacts.hpp"

#include <mujoco/mujoco.h>

#include "dashpot/model/contacts.hpp"

namespace dashpot::host {

bool add_surplus(mjData_* d, const std::vector<SurplusContact>& surplus) {
  const auto is_of = [](const mjContact& contact, const SurplusContact& c) {
    return contact.geom[0] == c.geom[0] && contact.geom[1] == c.geom[1];
  };
  // In the order of their pairs, as MuJoCo asks for them: backwards, from the last to the first.
  const int found = d->ncon, count = static_cast<int>(surplus.size());
  int left = count;
  for (int from = found - 1; from >= 0; --from)
    while (left > 0 && is_of(d->contact[from], surplus[left - 1])) --left;
  if (left > 0) return false;  // MuJoCo had no room for the others of a pair
  if (!make_room_for_contacts(d, count)) return false;
  left = count;
  for (int from = found - 1, to = d->ncon; left > 0; --from) {
    for (; left > 0 && is_of(d->contact[from], surplus[left - 1]); --left) {
      const SurplusContact& more = surplus[left - 1];
      mjContact& contact = d->contact[--to] = d->contact[from];
      contact.dist = more.distance;
      mju_copy3(contact.pos, more.position.data());
      set_frame(more.normal.data(), contact.frame);
    }
    d->contact[--to] = d->contact[from];
  }
  return true;
}

}  // namespace dashpot::host
