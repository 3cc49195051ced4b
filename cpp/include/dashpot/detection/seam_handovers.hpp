// Contacts of round geoms that roll over a seam, which the tile ahead takes over
// (detection/seams.hpp).

#pragma once

#include <vector>

#include "dashpot/detection/bearers.hpp"
#include "dashpot/detection/geom_faces.hpp"

namespace dashpot::host {

// Whether a contact is that of a round geom and a tile: of a geom without flat faces, and of one
// with some on a body that may have others beside it.
bool may_roll_over_a_seam(const mjModel_* m, const ContactInput& contact);

class SeamHandovers {
 public:
  SeamHandovers(const mjModel_* m, const mjData_* d, const Bearers& bearers, FaceBuffers& faces,
                std::vector<ContactInput>& contacts)
      : m_(m), d_(d), bearers_(bearers), faces_(faces), contacts_(contacts) {}

  // Where a round geom has left a tile over its edge, with all of its contacts from `first` to
  // `last` that touch, has others take them over and marks them (`at_seam`). A line across a seam
  // stays on both sides. `successor`: a buffer.
  void hand_over(size_t first, size_t last, std::vector<int>& successor,
                 std::vector<char>& at_seam);

 private:
  int successor_of(size_t index);
  bool is_fixed_to(int geom, int other) const;
  bool is_before(size_t a, size_t b) const;
  bool are_in_one_place(const ContactInput& contact, const ContactInput& rest) const;
  bool is_beneath(const ContactInput& contact, const ContactInput& rest) const;
  bool is_flush(int geom, const ContactInput& rest);

  const mjModel_* m_;
  const mjData_* d_;
  const Bearers& bearers_;
  FaceBuffers& faces_;
  std::vector<ContactInput>& contacts_;
};

}  // namespace dashpot::host
