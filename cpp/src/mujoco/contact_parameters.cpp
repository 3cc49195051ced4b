// MuJoCo's rules (documentation, "Contact parameters"): an explicit <pair> says everything; else
// the geom of the higher priority; else the larger friction and condim count, a solref with a
// negative number is taken element by element from the lower one, and solref and solimp are
// otherwise averaged with the weights solmix.

#include "dashpot/mujoco/contact_parameters.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>

#include "dashpot/mujoco/constraints.hpp"

namespace dashpot::host {

namespace {

template <size_t N>
std::array<double, N> numbers(const mjtNum* from) {
  std::array<double, N> result;
  std::copy_n(from, N, result.begin());
  return result;
}

ContactParameters of_geom(const mjModel* m, int geom) {
  const mjtNum* f = m->geom_friction + 3 * geom;
  return {m->geom_condim[geom],
          {f[0], f[0], f[1], f[2], f[2]},
          numbers<2>(m->geom_solref + mjNREF * geom),
          {},
          numbers<5>(m->geom_solimp + mjNIMP * geom)};
}

// Share of the first of two geoms in what solmix averages.
double share_of_first(double first, double second) {
  const bool has_first = first >= mjMINVAL, has_second = second >= mjMINVAL;
  if (has_first && has_second) return first / (first + second);
  return has_first == has_second ? 0.5 : has_first ? 1.0 : 0.0;
}

ContactParameters mixed(const ContactParameters& a, const ContactParameters& b, double share) {
  const auto mean = [&](double x, double y) { return share * x + (1.0 - share) * y; };
  // What is no number is not passed over: it is an error where it comes to be used.
  const auto lower = [](double x, double y) { return x < y || std::isnan(x) ? x : y; };
  ContactParameters result = a;
  result.dim = std::max(a.dim, b.dim);
  for (size_t i = 0; i < result.friction.size(); ++i)
    result.friction[i] = std::max(a.friction[i], b.friction[i]);
  const bool both_times = a.solref[0] > 0.0 && b.solref[0] > 0.0;
  for (size_t i = 0; i < result.solref.size(); ++i)
    result.solref[i] =
        both_times ? mean(a.solref[i], b.solref[i]) : lower(a.solref[i], b.solref[i]);
  for (size_t i = 0; i < result.solimp.size(); ++i)
    result.solimp[i] = mean(a.solimp[i], b.solimp[i]);
  return result;
}

// MuJoCo lets no coefficient of friction be less.
ContactParameters with_least_friction(ContactParameters parameters) {
  for (double& coefficient : parameters.friction) coefficient = std::max(coefficient, mjMINMU);
  return parameters;
}

ContactParameters parameters_of(const mjModel* m, int geom1, int geom2) {
  const int pair = defining_pair(m, geom1, geom2);
  return pair >= 0 ? parameters_of_pair(m, pair) : parameters_of_geoms(m, geom1, geom2);
}

}  // namespace

int defining_pair(const mjModel_* m, int geom1, int geom2) {
  for (int pair = 0; pair < m->npair; ++pair)
    if (std::minmax(m->pair_geom1[pair], m->pair_geom2[pair]) == std::minmax(geom1, geom2))
      return pair;
  return -1;
}

double gap_of(const mjModel_* m, const mjContact_& contact, const GapArrays& gaps) {
  const int pair = defining_pair(m, contact.geom[0], contact.geom[1]);
  if (pair >= 0) return gaps.pair[pair];
  const auto of_side = [&](int side) {
    return contact.geom[side] < 0 ? gaps.flex[contact.flex[side]] : gaps.geom[contact.geom[side]];
  };
  return of_side(0) + of_side(1);
}

ContactParameters parameters_of_pair(const mjModel_* m, int pair) {
  return with_least_friction({m->pair_dim[pair], numbers<5>(m->pair_friction + 5 * pair),
                              numbers<2>(m->pair_solref + mjNREF * pair),
                              numbers<2>(m->pair_solreffriction + mjNREF * pair),
                              numbers<5>(m->pair_solimp + mjNIMP * pair)});
}

ContactParameters parameters_of_geoms(const mjModel_* m, int geom1, int geom2) {
  const int priority1 = m->geom_priority[geom1], priority2 = m->geom_priority[geom2];
  if (priority1 != priority2)
    return with_least_friction(of_geom(m, priority1 > priority2 ? geom1 : geom2));
  return with_least_friction(mixed(of_geom(m, geom1), of_geom(m, geom2),
                                   share_of_first(m->geom_solmix[geom1], m->geom_solmix[geom2])));
}

ContactInput contact_of_pair(const mjModel_* m, int geom1, int geom2) {
  const ContactParameters parameters = parameters_of(m, geom1, geom2);
  ContactInput input;
  input.geom = {geom1, geom2};
  input.dim = parameters.dim;
  input.friction = parameters.friction;
  input.solref = parameters.solref;
  input.solimp = parameters.solimp;
  input.has_solref = !is_default_impedance(input.solref.data(), input.solimp.data());
  return input;
}

}  // namespace dashpot::host
