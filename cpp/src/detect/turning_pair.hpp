// The contacts of two geoms that may turn in a step: whether they do, and the time at which each of
// them is frozen (turning.hpp), as pair_ahead.hpp sees it then.

#pragma once

#include <mujoco/mujoco.h>

#include "contact_motion.hpp"
#include "dashpot/detect/turning_step.hpp"
#include "dashpot/rows/rows.hpp"
#include "far_pair.hpp"
#include "isolated_pairs.hpp"
#include "pair_ahead.hpp"
#include "pair_hits.hpp"

namespace dashpot::host {

struct FaceBuffers;

class TurningPair {
 public:
  // Of the contacts from `first` to `last`.
  TurningPair(mjModel* m, mjData* d, const TurningStep& step, const IsolatedPairs& pairs,
              ContactInput* first, ContactInput* last)
      : data_(d),
        step_(step),
        first_(first),
        last_(last),
        hit_speed_(pairs.hit_speed()),
        motion_(m, d, step.length),
        hits_(motion_, step, pairs),
        far_(motion_),
        ahead_(m, d, motion_, far_, pairs, step.length, first, last) {}

  // Finds how the pair moves; whether it does, and may touch up to the middle or is hit.
  bool moves();
  // Of a pair whose contacts stay where they are, takes to the middle the axes of the joints that
  // hold it there: those of a leg turn though its foot stands.
  void turn_axes();
  // Freezes the contacts that are found there in the middle of the step, or of their hit.
  void freeze(FaceBuffers& faces);

 private:
  double middle() const { return 0.5 * step_.length; }
  bool are_soft_balls() const;
  bool changes_arm() const;
  bool parts_early() const;
  ContactInput* seen_at(FaceBuffers& faces, const ContactInput& contact, double time);
  const ContactInput* in_its_time(FaceBuffers& faces, ContactInput& contact);
  void freeze_after_impact(FaceBuffers& faces, ContactInput& contact);
  bool comes(const ContactInput& contact) const;
  bool normal_turns(const ContactInput& then, const ContactInput& contact) const;
  bool freeze_where_it_is_met(FaceBuffers& faces, ContactInput& contact);
  void take_geometry(const ContactInput& then, ContactInput& contact);

  mjData* data_;
  const TurningStep& step_;
  ContactInput *first_, *last_;
  double hit_speed_;  // m/s
  ContactMotion motion_;
  PairHits hits_;
  FarPair far_;
  PairAhead ahead_;
  double size_ = 0.0;       // m, radius about the smaller geom
  double same_time_ = 0.0;  // s, by which two times may differ that see one geometry
  bool at_rest_ = false;    // its geoms, on each other
  bool is_round_hit_ = false, goes_far_ = false;
  bool stays_ = false;  // but for contacts that come
};

}  // namespace dashpot::host
