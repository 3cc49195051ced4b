#include "dashpot/contacts.hpp"

#include "dashpot/engine.hpp"
#include "dashpot/mujoco_host.hpp"

namespace dashpot {

namespace {

ContactMemory memory_of(const mjModel_* m, mjData_* d) {
  return ContactMemory(host::memory(m, d, memory_size(m)), contact_capacity(host::geom_count(m)));
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

int memory_size(const mjModel_* m) {
  return ContactMemory::size(contact_capacity(host::geom_count(m)));
}

EnergyLedger read_ledger(const mjModel_* m, mjData_* d) { return memory_of(m, d).ledger(); }

ContactReport report_contacts(const mjModel_* m, mjData_* d) {
  ContactReport report;
  std::vector<ContactInput> inputs;
  host::read_contacts(m, d, inputs);
  const ContactMemory memory = memory_of(m, d);
  std::vector<int> slot_of(host::detected_count(d), -1);
  for (int i = 0; i < memory.count(); ++i) {
    const auto source = static_cast<size_t>(memory.at(i).source);
    if (source < slot_of.size()) slot_of[source] = i;
  }
  for (const ContactInput& input : inputs) {
    const std::array<double, 6> wrench = host::contact_force(m, d, input.source);
    report.geom.push_back(input.geom);
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
    const RememberedContact memory_slot = memory.at(slot);
    report.compression.push_back(memory_slot.compression);
    report.displacement.push_back({-memory_slot.compression, along(input, memory_slot.slide, 1),
                                   along(input, memory_slot.slide, 2)});
    report.sticking.push_back(memory_slot.sticking != 0.0);
  }
  return report;
}

}  // namespace dashpot
