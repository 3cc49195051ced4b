// Contacts in mjData, and what an MJCF says about those of two geoms.

#pragma once

#include <array>
#include <vector>

#include "dashpot/model/mujoco_types.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot::host {

// Values of mjContact::exclude. MuJoCo leaves contacts beyond the margin out of its rows.
inline constexpr int kIncluded = 0, kInGap = 1;

// Reads contact `index` of data; false where it loads nothing: it is excluded, or moves nothing.
bool read_contact(const mjModel_* m, const mjData_* d, int index, ContactInput& contact);
// The contacts of the last step as data still hold them.
void read_contacts(const mjModel_* m, const mjData_* d, std::vector<ContactInput>& contacts);
// Appends `count` contacts that are yet to be filled in, first in the arena, as mj_addContact has
// them; it forgets about rows each time. False, and none, where the model's memory is too small.
bool make_room_for_contacts(mjData_* d, int count);
// The frame (9) that MuJoCo gives a contact of this normal, and tangent where collision finds one.
void set_frame(const double* normal, double* frame);
void set_frame(const double* normal, const double* tangent, double* frame);
// Gives a contact another position, normal (both world) and gap, also in `d`.
void redirect_contact(mjData_* d, const double* position, const double* normal, double gap,
                      ContactInput& contact);
// Detection reaches ahead, further than the margin and gap of the model. Contacts that are beyond
// them and not `touched`, by index in `d`, count no more: they go behind the others, where rows
// still find them. Those in the gap that do not adhere are marked as MuJoCo marks them. `contacts`
// get their new places. Whether any are left out.
bool leave_out_untouched(const mjModel_* m, mjData_* d, const std::vector<char>& touched,
                         std::vector<ContactInput>& contacts);
int detected_count(const mjData_* d);
// Force and torque of a detected contact in its frame, N and N m. Throws std::runtime_error where
// the last step has left no rows of contacts.
std::array<double, 6> contact_force(const mjModel_* m, const mjData_* d, int index);

// Index of the <pair> that defines the contacts of two geoms, in any order; -1 for none.
int defining_pair(const mjModel_* m, int geom1, int geom2);

// Gaps (m) by geom, <pair> and flex: a model's own, or what they were before they were widened.
struct GapArrays {
  const double *geom, *pair, *flex;
};
// How far beyond its margin a contact is detected.
double gap_of(const mjModel_* m, const mjContact_& contact, const GapArrays& gaps);

// Of contacts of two geoms, and of those that a <pair> defines.
struct ContactParameters {
  int dim = 1;
  std::array<double, 5> friction{};
  std::array<double, 2> solref{};
  std::array<double, 2> solreffriction{};  // zeros: as solref
  std::array<double, 5> solimp{};
};
ContactParameters parameters_of_geoms(const mjModel_* m, int geom1, int geom2);
ContactParameters parameters_of_pair(const mjModel_* m, int pair);

// A contact of two geoms of a model, with all that the model says about it and no geometry: what
// MuJoCo gives the contacts that it detects between them.
ContactInput contact_of_pair(const mjModel_* m, int geom1, int geom2);

}  // namespace dashpot::host
