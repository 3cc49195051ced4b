#include "dashpot/step/contacts.hpp"

#include <algorithm>
#include <utility>

#include "dashpot/model/constraint_memory.hpp"
#include "dashpot/model/contacts.hpp"
#include "dashpot/model/forces.hpp"
#include "dashpot/model/mocap_motion.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/model/state.hpp"
#include "dashpot/model/trees.hpp"
#include "dashpot/model/velocities.hpp"

namespace dashpot {

namespace {

Memory memory_of(const mjModel_* m, mjData_* d, int contact_capacity) {
  const MemoryLayout layout = memory_layout(m, contact_capacity);
  const Memory memory(host::memory(m, d, layout.size()), layout);
  memory.check();
  return memory;
}

// Components of a vector of geom 1's frame along the rows of the contact frame.
double along(const ContactInput& input, const double* local, int row) {
  double sum = 0.0;
  for (int j = 0; j < 3; ++j)
    for (int i = 0; i < 3; ++i)
      sum += local[i] * input.rotation[3 * j + i] * input.frame[3 * row + j];
  return sum;
}

}  // namespace

MemoryLayout memory_layout(const mjModel_* m, int contact_capacity) {
  MemoryLayout layout;
  layout.positions = host::position_count(m);
  layout.contacts = contact_capacity;
  layout.geoms = host::geom_count(m);
  layout.flexes = host::flex_count(m);
  layout.constraints = host::constraint_memory_count(m);
  const Trees trees = host::make_trees(m);
  const bool has_links = std::any_of(trees.tree.begin(), trees.tree.end(),
                                     [](const Tree& tree) { return !tree.free_body; });
  if (has_links || host::has_equalities(m)) {
    layout.held_trees = static_cast<int>(trees.tree.size());
    layout.held_dofs = host::dof_count(m);
    layout.held_coordinates = trees.coordinates;
  }
  layout.driven_bodies = host::driven_count(m);
  return layout;
}

EnergyLedger read_ledger(const mjModel_* m, mjData_* d, int contact_capacity) {
  return memory_of(m, d, contact_capacity).ledger();
}

ContactReport report_contacts(const mjModel_* m, mjData_* d, int contact_capacity) {
  ContactReport report;
  std::vector<ContactInput> inputs;
  host::read_contacts(m, d, inputs);
  const Memory memory = memory_of(m, d, contact_capacity);
  std::vector<int> slot_of(host::detected_count(d), -1);
  for (int i = 0; i < memory.contact_count(); ++i) {
    const double source = memory.contact(i).source;
    if (source >= 0.0 && source < slot_of.size()) slot_of[static_cast<size_t>(source)] = i;
  }
  for (const ContactInput& input : inputs) {
    const std::array<double, 6> wrench = host::contact_force(m, d, input.source);
    std::array<int, 2> geom = input.geom, flex = {-1, -1};
    for (int side = 0; side < 2; ++side)
      if (geom[side] < 0) flex[side] = -1 - std::exchange(geom[side], -1);
    report.geom.push_back(geom);
    report.flex.push_back(flex);
    report.position.push_back(input.position);
    report.frame.push_back(input.frame);
    report.gap.push_back(input.gap);
    report.velocity.push_back(host::contact_velocity(m, d, input));
    report.force.push_back({wrench[0], wrench[1], wrench[2]});
    report.torque.push_back({wrench[3], wrench[4], wrench[5]});
    const int slot = slot_of[input.source];
    if (slot < 0) {
      report.compression.push_back(0.0);
      report.displacement.push_back({0.0, 0.0, 0.0});
      report.sticking.push_back(0);
      continue;
    }
    const RememberedContact memory_slot = memory.contact(slot);
    report.compression.push_back(memory_slot.compression);
    report.displacement.push_back({-memory_slot.compression, along(input, memory_slot.slide, 1),
                                   along(input, memory_slot.slide, 2)});
    report.sticking.push_back(memory_slot.sticking != 0.0);
  }
  return report;
}

std::array<double, 2> mechanical_energy(const mjModel_* m, const mjData_* d, mjData_* scratch,
                                        int contact_capacity) {
  host::copy_state(m, d, scratch);
  host::MocapBuffers buffers;
  host::MocapMotion mocap(m, scratch, true, 0.0, memory_of(m, scratch, contact_capacity), buffers);
  mocap.show(0.0);
  return host::mechanical_energy(m, scratch);
}

}  // namespace dashpot
