#include "dashpot/detect/narrowphase.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <utility>

#include "dashpot/detect/collisions.hpp"
#include "dashpot/lanes/prefetch.hpp"
#include "dashpot/model/contacts.hpp"

namespace dashpot::host {

namespace {

constexpr int kPairsAtOnce = 16;  // by a thread

// No contacts, and no rows that lie behind them.
void clear_contacts(mjModel* m, mjData* d) {
  const int flags = m->opt.disableflags;
  m->opt.disableflags |= mjDSBL_CONTACT;
  mj_collision(m, d);
  m->opt.disableflags = flags;
}

mjContact contact_of(const mjModel* m, const CandidatePair& pair) {
  const ContactParameters parameters = pair.defined >= 0
                                           ? parameters_of_pair(m, pair.defined)
                                           : parameters_of_geoms(m, pair.geom[0], pair.geom[1]);
  mjContact contact{};
  contact.includemargin = margin_of(m, pair);
  contact.dim = parameters.dim;
  std::copy(parameters.friction.begin(), parameters.friction.end(), contact.friction);
  std::copy(parameters.solref.begin(), parameters.solref.end(), contact.solref);
  std::copy(parameters.solreffriction.begin(), parameters.solreffriction.end(),
            contact.solreffriction);
  std::copy(parameters.solimp.begin(), parameters.solimp.end(), contact.solimp);
  contact.geom1 = contact.geom[0] = pair.geom[0];
  contact.geom2 = contact.geom[1] = pair.geom[1];
  for (int side = 0; side < 2; ++side)
    contact.flex[side] = contact.elem[side] = contact.vert[side] = -1;
  contact.efc_address = -1;
  return contact;
}

}  // namespace

void Narrowphase::find(mjModel_* m, mjData_* d, const std::vector<CandidatePair>& pairs,
                       FaceBuffers* faces, Scratch& scratch, Team& team) {
  std::swap(before_, now_);
  now_.pairs.clear();
  now_.contacts.clear();
  const int count = static_cast<int>(pairs.size());
  const int range = team.range_size(count, kPairsAtOnce);
  found_.resize(count / range + 1);
  for (Found& found : found_) {
    found.pairs.clear();
    found.contacts.clear();
  }
  apart_.make_room();
  scratch.open(m, d, faces, range < count ? team.active() : 1);
  team.share(count, kPairsAtOnce, [&](int worker, int first, int last) {
    const WorkerScratch at(scratch, worker);
    find_in(at.model(), at.data(), pairs.data() + first, pairs.data() + last,
            found_[first / range]);
  });
  scratch.close();
  const auto is_empty = [](const Found& found) { return found.pairs.empty(); };
  if (std::all_of(found_.begin() + 1, found_.end(), is_empty))
    return std::swap(now_, found_.front());
  for (const Found& found : found_) {
    const int before = static_cast<int>(now_.contacts.size());
    for (const FoundPair& of : found.pairs)
      now_.pairs.push_back({of.pair, before + of.first, of.count});
    now_.contacts.insert(now_.contacts.end(), found.contacts.begin(), found.contacts.end());
  }
}

void Narrowphase::find_in(const mjModel_* m, mjData_* d, const CandidatePair* first_pair,
                          const CandidatePair* last_pair, Found& all) {
  mjPreContact found[mjMAXCONPAIR];
  auto old = std::lower_bound(
      before_.pairs.begin(), before_.pairs.end(), *first_pair,
      [](const FoundPair& a, const CandidatePair& b) { return comes_before(a.pair, b); });
  for (const CandidatePair* at = first_pair; at != last_pair; ++at) {
    if (last_pair - at > static_cast<int>(kPrefetched))
      for (int geom : at[kPrefetched].geom) {
        prefetch(d->geom_xpos + 3 * geom, 3 * sizeof(mjtNum));
        prefetch(d->geom_xmat + 9 * geom, 9 * sizeof(mjtNum));
        prefetch(m->geom_size + 3 * geom, 3 * sizeof(mjtNum));
      }
    const CandidatePair& pair = *at;
    const double within = pair.within;
    const int first = static_cast<int>(all.contacts.size());
    while (old != before_.pairs.end() && comes_before(old->pair, pair)) ++old;
    if (old != before_.pairs.end() && !comes_before(pair, old->pair) &&
        old->pair.within == within) {
      const auto begin = before_.contacts.begin() + old->first;
      all.contacts.insert(all.contacts.end(), begin, begin + old->count);
      all.pairs.push_back({pair, first, old->count});
      continue;
    }
    if (apart_.are_apart(m, d, pair, within)) continue;
    const int count = collide_all(m, d, pair.geom[0], pair.geom[1], within, found);
    if (count == 0) apart_.find_distance(m, d, pair, within);
    all.pairs.push_back({pair, first, count});
    for (const mjPreContact* c = found; c != found + count; ++c)
      all.contacts.push_back({c->dist,
                              {c->pos[0], c->pos[1], c->pos[2]},
                              {c->normal[0], c->normal[1], c->normal[2]},
                              {c->tangent[0], c->tangent[1], c->tangent[2]}});
  }
}

void Narrowphase::write(mjModel_* m, mjData_* d, Team& team) const {
  clear_contacts(m, d);
  int room = static_cast<int>(now_.contacts.size());
  while (!make_room_for_contacts(d, room)) --room;
  team.for_each(static_cast<int>(now_.pairs.size()), kPairsAtOnce, [&](int i) {
    const FoundPair& of = now_.pairs[i];
    if (of.count == 0 || of.first >= room) return;
    const mjContact of_pair = contact_of(m, of.pair);
    for (int place = of.first; place < std::min(room, of.first + of.count); ++place) {
      const FoundContact& found = now_.contacts[place];
      mjContact& contact = d->contact[place];
      contact = of_pair;
      contact.dist = found.distance;
      mju_copy3(contact.pos, found.position.data());
      set_frame(found.normal.data(), found.tangent.data(), contact.frame);
      contact.exclude = contact.dist >= contact.includemargin;
    }
  });
  if (room < static_cast<int>(now_.contacts.size())) mj_warning(d, mjWARN_CONTACTFULL, d->ncon);
}

}  // namespace dashpot::host
