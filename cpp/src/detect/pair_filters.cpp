#include "dashpot/detect/pair_filters.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <tuple>
#include <utility>

#include "dashpot/detect/detection.hpp"

namespace dashpot::host {

namespace {

unsigned signature_of(int body1, int body2) {
  return (static_cast<unsigned>(std::min(body1, body2)) << 16) +
         static_cast<unsigned>(std::max(body1, body2));
}

bool is_excluded(const mjModel* m, int body1, int body2) {
  int* const end = m->exclude_signature + m->nexclude;
  return std::find(m->exclude_signature, end, static_cast<int>(signature_of(body1, body2))) != end;
}

bool have_common_bits(const int* contype, const int* conaffinity, int a, int b) {
  return (contype[a] & conaffinity[b]) || (contype[b] & conaffinity[a]);
}

template <typename T>
bool any_positive(const T* values, mjtSize count) {
  return std::any_of(values, values + count, [](T value) { return value > 0; });
}

bool may_have_constraints(const mjModel* m) {
  const auto enabled = [&](int flag) { return !(m->opt.disableflags & flag); };
  return (enabled(mjDSBL_EQUALITY) && m->neq > 0) ||
         (enabled(mjDSBL_LIMIT) &&
          (any_positive(m->jnt_limited, m->njnt) || any_positive(m->tendon_limited, m->ntendon))) ||
         (enabled(mjDSBL_FRICTIONLOSS) && (any_positive(m->dof_frictionloss, m->nv) ||
                                           any_positive(m->tendon_frictionloss, m->ntendon)));
}

bool may_have_contacts(const mjModel* m) {
  if (m->opt.disableflags & mjDSBL_CONTACT) return false;
  if (m->npair > 0 || m->nflex > 0) return true;
  for (int geom1 = 0; geom1 < m->ngeom; ++geom1) {
    if (!m->geom_contype[geom1] && !m->geom_conaffinity[geom1]) continue;
    for (int geom2 = geom1 + 1; geom2 < m->ngeom; ++geom2)
      if (may_meet(m, geom1, geom2)) return true;
  }
  return false;
}

}  // namespace

CandidatePair pair_of(const mjModel_* m, int geom1, int geom2, int defined) {
  const unsigned bodies = signature_of(m->geom_bodyid[geom1], m->geom_bodyid[geom2]);
  if (m->geom_type[geom1] > m->geom_type[geom2]) std::swap(geom1, geom2);
  return {{geom1, geom2}, defined, bodies};
}

bool comes_before(const CandidatePair& a, const CandidatePair& b) {
  if (a.bodies != b.bodies) return a.bodies < b.bodies;
  if ((a.defined < 0) != (b.defined < 0)) return b.defined < 0;
  return std::tie(a.defined, a.geom) < std::tie(b.defined, b.geom);
}

bool may_meet(const mjModel_* m, int geom1, int geom2) {
  const int body1 = m->geom_bodyid[geom1], body2 = m->geom_bodyid[geom2];
  if (!have_common_bits(m->geom_contype, m->geom_conaffinity, geom1, geom2) ||
      !have_common_bits(m->body_contype, m->body_conaffinity, body1, body2))
    return false;
  const int weld1 = m->body_weldid[body1], weld2 = m->body_weldid[body2];
  if (m->body_treeid[body1] < 0 && m->body_treeid[body2] < 0) return false;
  if (weld1 == weld2 || is_excluded(m, body1, body2)) return false;
  if (m->opt.disableflags & mjDSBL_FILTERPARENT || weld1 == 0 || weld2 == 0) return true;
  const int parent1 = m->body_weldid[m->body_parentid[weld1]];
  const int parent2 = m->body_weldid[m->body_parentid[weld2]];
  return weld1 != parent2 && weld2 != parent1;
}

double margin_of(const mjModel_* m, const CandidatePair& pair) {
  return pair.defined >= 0 ? m->pair_margin[pair.defined]
                           : m->geom_margin[pair.geom[0]] + m->geom_margin[pair.geom[1]];
}

double gap_of(const mjModel_* m, const CandidatePair& pair) {
  return pair.defined >= 0 ? m->pair_gap[pair.defined]
                           : m->geom_gap[pair.geom[0]] + m->geom_gap[pair.geom[1]];
}

bool have_collision(const mjModel_* m, const CandidatePair& pair) {
  return mjCOLLISIONFUNC[m->geom_type[pair.geom[0]]][m->geom_type[pair.geom[1]]] != nullptr;
}

bool may_have_rows(const mjModel_* m) {
  if (m->opt.disableflags & mjDSBL_CONSTRAINT) return false;
  return may_have_constraints(m) || may_have_contacts(m);
}

}  // namespace dashpot::host
