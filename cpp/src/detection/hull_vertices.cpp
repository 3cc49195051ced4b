#include "dashpot/detection/hull_vertices.hpp"

#include <mujoco/mujoco.h>

namespace dashpot::host {

HullVertices::HullVertices(const mjModel_* m, int mesh)
    : vertex_(m->mesh_vert + 3 * m->mesh_vertadr[mesh]), count_(m->mesh_vertnum[mesh]) {
  if (m->mesh_graphadr[mesh] < 0) return;
  // mesh_graph: numvert, numface, edge address per vertex, mesh vertex per hull vertex, ...
  const int* const graph = m->mesh_graph + m->mesh_graphadr[mesh];
  count_ = graph[0];
  of_hull_ = graph + 2 + count_;
}

}  // namespace dashpot::host
