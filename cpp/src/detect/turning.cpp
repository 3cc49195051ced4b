#include "dashpot/detect/turning.hpp"

#include "dashpot/detect/scratch.hpp"
#include "isolated_pairs.hpp"
#include "turning_pair.hpp"

namespace dashpot::host {

namespace {

constexpr int kContactsAtOnce = 16;  // by a thread

}  // namespace

void freeze_contacts(mjModel_* m, mjData_* d, const TurningStep& step, FaceBuffers& faces,
                     Scratch& scratch, std::vector<ContactInput>& contacts,
                     std::vector<double>& tree_ahead, Team& team) {
  const int count = static_cast<int>(contacts.size());
  const auto begins_pair = [&](int i) {
    return i == 0 || i == count || !contacts[i].is_of_pair(contacts[i - 1].geom);
  };
  const IsolatedPairs pairs(m, d, step, contacts);
  scratch.open(m, d, &faces, count > kContactsAtOnce ? team.active() : 1);
  team.share(count, kContactsAtOnce, [&](int worker, int begin, int end) {
    const WorkerScratch at(scratch, worker);
    // Pairs that begin in the range.
    while (begin < end && !begins_pair(begin)) ++begin;
    for (int first = begin, last; first < end; first = last) {
      last = first + 1;
      while (!begins_pair(last)) ++last;
      TurningPair pair(at.model(), at.data(), step, pairs, contacts.data() + first,
                       contacts.data() + last);
      if (pair.moves())
        pair.freeze(*at.faces());
      else
        pair.turn_axes();
    }
  });
  scratch.close();
  for (const ContactInput& contact : contacts) {
    if (contact.frozen != Frozen::kAhead) continue;
    for (int tree : contact.tree) {
      if (tree < 0) continue;
      double& ahead = tree_ahead[tree];
      ahead = ahead == 0.0 || ahead == contact.ahead ? contact.ahead : 0.5 * step.length;
    }
  }
}

}  // namespace dashpot::host
