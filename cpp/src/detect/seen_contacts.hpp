// The contacts of a pair of geoms at a time within a step, and which of those at its start they
// continue.

#pragma once

#include <mujoco/mujoco.h>

#include <array>

#include "contact_motion.hpp"
#include "dashpot/rows/rows.hpp"

namespace dashpot::host {

struct FaceBuffers;

// A contact that the collision of a pair finds then, and its place on the two geoms.
struct SeenContact {
  mjtNum distance, position[3], normal[3];
  mjtNum local_normal[2][3];  // in the frames of the geoms
  std::array<double, 3> local[2];
  std::array<double, 3> on_shape[2];  // the same on what does not turn about its own axis
};

// Squared distance (m^2) of the places of two contacts on the geom on which they are nearer: on a
// wheel, the place as it turns with it, or stays.
double squared_distance_on_geoms(const ContactInput& start, const SeenContact& seen);

// All of a pair.
class SeenContacts {
 public:
  // In a step of `length` (s).
  SeenContacts(const ContactMotion& motion, double length) : motion_(motion), length_(length) {}

  // Asks for collision with the geoms where they are after `time` (s), out to the distance `reach`
  // (m). The poses in `d` are those of the start again afterwards.
  void find(mjModel* m, mjData* d, double time, double reach, FaceBuffers& faces);

  // The nearest that may continue a contact of the start, null if none may.
  const SeenContact* continuation(const ContactInput& contact) const;
  // Of the contacts of the start from `first` to `last` the nearest that it may continue.
  ContactInput* start_of(const SeenContact& seen, ContactInput* first, ContactInput* last) const;

  // Rotation of the first geom then, row-major, local to world.
  const mjtNum* rotation() const { return rotation_; }

 private:
  double distance_of(const ContactInput& contact, const SeenContact& seen) const;
  bool is_across_groove(const ContactInput& contact, const SeenContact& seen) const;

  const ContactMotion& motion_;
  double length_;
  std::array<SeenContact, mjMAXCONPAIR> contact_;
  int count_ = 0;
  mjtNum rotation_[9]{};
};

}  // namespace dashpot::host
