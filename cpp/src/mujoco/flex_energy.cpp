#include "dashpot/mujoco/flex_energy.hpp"

#include <mujoco/mujoco.h>

#include <array>

namespace dashpot::host {

namespace {

// How MuJoCo 3.17 packs what an element and an edge have: the upper triangle of a symmetric matrix
// over the element's edges; one over the four vertices about an edge, and the stiffness that its
// curvature at rest gives their volume.
constexpr int kOfTriangle = 21, kOfTetrahedron = 24, kOfEdge = 17, kCurvature = 16;

const mjtNum* vertex(const mjModel* m, const mjData* d, int flex, int index) {
  return d->flexvert_xpos + 3 * (m->flex_vertadr[flex] + index);
}

// A quarter of the products of what squares of lengths differ by from those at rest.
double stretch_energy(const mjModel* m, const mjData* d, int flex) {
  const bool is_solid = m->flex_dim[flex] == 3;
  const int edges = is_solid ? 6 : 3;
  double energy = 0.0;
  for (int element = 0; element < m->flex_elemnum[flex]; ++element) {
    const int* edge = m->flex_elemedge + m->flex_elemedgeadr[flex] + edges * element;
    std::array<double, 6> change{};
    for (int i = 0; i < edges; ++i) {
      const int at = m->flex_edgeadr[flex] + edge[i];
      const double length = mju_dist3(vertex(m, d, flex, m->flex_edge[2 * at]),
                                      vertex(m, d, flex, m->flex_edge[2 * at + 1]));
      change[i] = length * length - m->flexedge_length0[at] * m->flexedge_length0[at];
    }
    const mjtNum* stiffness = m->flex_stiffness + m->flex_stiffnessadr[flex] +
                              (is_solid ? kOfTetrahedron : kOfTriangle) * element;
    for (int i = 0; i < edges; ++i)
      for (int j = i; j < edges; ++j)
        energy += (i == j ? 0.25 : 0.5) * *stiffness++ * change[i] * change[j];
  }
  return energy;
}

double bending_energy(const mjModel* m, const mjData* d, int flex) {
  double energy = 0.0;
  for (int edge = 0; edge < m->flex_edgenum[flex]; ++edge) {
    const int at = m->flex_edgeadr[flex] + edge;
    const int* flap = m->flex_edgeflap + 2 * at;
    if (flap[1] < 0) continue;  // on the rim
    const std::array<const mjtNum*, 4> x = {
        vertex(m, d, flex, m->flex_edge[2 * at]), vertex(m, d, flex, m->flex_edge[2 * at + 1]),
        vertex(m, d, flex, flap[0]), vertex(m, d, flex, flap[1])};
    const mjtNum* stiffness = m->flex_bending + m->flex_bendingadr[flex] + kOfEdge * edge;
    mjtNum side[3][3], across[3];
    for (int i = 0; i < 3; ++i) mju_sub3(side[i], x[i + 1], x[0]);
    // Rows of the matrix add up to zero: positions count from the first vertex.
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        energy += 0.5 * stiffness[4 * (i + 1) + j + 1] * mju_dot3(side[i], side[j]);
    mju_cross(across, side[1], side[2]);
    energy += stiffness[kCurvature] * mju_dot3(side[0], across);
  }
  return energy;
}

}  // namespace

double flex_energy(const mjModel_* m, const mjData_* d) {
  double energy = 0.0;
  if (m->opt.disableflags & mjDSBL_SPRING) return energy;
  for (int flex = 0; flex < m->nflex; ++flex) {
    if (m->flex_rigid[flex] || m->flex_interp[flex] || m->flex_dim[flex] < 2) continue;
    if (m->flex_stiffnessadr[flex] >= 0) energy += stretch_energy(m, d, flex);
    if (m->flex_bendingadr[flex] >= 0) energy += bending_energy(m, d, flex);
  }
  return energy;
}

}  // namespace dashpot::host
