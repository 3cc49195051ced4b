// Which pairs of geoms can be in contact, kept over steps.
//
// MuJoCo looks for them anew in every step. Here every geom has room to move: its box along the
// world's axes, widened by its margin, its reach, and some more. As long as all geoms stay in
// their rooms, pairs whose rooms are apart cannot touch. Which contacts there are does not depend
// on what was kept: pairs are told apart again by their bounds at the present positions. MuJoCo's
// timers of collision and its marks of boxes that overlap (bvh_active) stay empty.

#pragma once

#include <array>
#include <vector>

#include "dashpot/detect/broadphase.hpp"
#include "dashpot/detect/joint_gaps.hpp"
#include "dashpot/threads/team.hpp"

namespace dashpot::host {

class Narrowing;

// A pair whose contacts are looked for less far, see detect/narrowing.hpp.
struct NarrowedPair {
  std::array<int, 2> geom;
  double margin = 0.0;
  double reach = 0.0;  // beyond the margin, m
};

// An interval along each of the world's axes, m.
struct Room {
  std::array<double, 3> low, high;
};

class CandidatePairs {
 public:
  // Whether pairs of geoms are all that collides, and these filters all there are: not where there
  // are flexes, signed distance fields or adhesion, callbacks that filter, where MuJoCo's own
  // threads look for contacts, or where its hierarchy of bounds, which orders them, is disabled.
  static bool cover(const mjModel_* m, const mjData_* d);

  // Those whose bounds come within the distance that contacts are looked for, in the order of
  // MuJoCo's contacts. `buffers` say how far geoms may move in the step. Valid until the next call.
  const std::vector<CandidatePair>& near(const mjModel_* m, const mjData_* d,
                                         const ReachBuffers& buffers, Narrowing& narrowing,
                                         Team& team);
  // Looks for all anew: the model was edited.
  void forget();

 private:
  struct PlaneAsGathered {
    std::array<double, 12> pose;
    double around = 0.0;  // margin and gap, m
  };
  void read_filters(const mjModel_* m);
  bool are_too_many(const std::vector<double>& reach) const;
  bool is_left(const mjModel_* m, const mjData_* d) const;
  void find_boxes(const mjModel_* m, const mjData_* d, Team& team);
  void gather(const mjModel_* m, const mjData_* d, const ReachBuffers& buffers);
  void check_places(const mjModel_* m, const mjData_* d) const;
  void gather_of_planes(const mjModel_* m, const mjData_* d, const ReachBuffers& buffers);
  void gather_of_rooms(const mjModel_* m, const mjData_* d, const ReachBuffers& buffers);
  void add(const mjModel_* m, const mjData_* d, int geom1, int geom2, const ReachBuffers& buffers);
  bool are_near(const mjModel_* m, const mjData_* d, const CandidatePair& pair) const;

  // What the filters read of the model, as it was; which geoms belong to which bodies stays.
  std::vector<int> filters_, filters_now_;
  std::vector<int> bounded_, planes_;         // geoms that may collide
  std::vector<PlaneAsGathered> as_gathered_;  // by index in planes_
  std::vector<BoundingBox> boxes_;            // by geom
  std::vector<Room> present_, rooms_;         // by geom
  std::vector<int> order_;                    // of bounded geoms along an axis
  std::vector<CandidatePair> all_, near_;
  JointGaps joint_gaps_;
  // What threads find, by range of all_, until it is put together.
  struct NearOfRange {
    std::vector<CandidatePair> pairs;
    std::vector<NarrowedPair> narrowed;
  };
  std::vector<NearOfRange> near_of_range_;
  double reach_ = 0.0;  // m, of all geoms together when pairs were gathered
};

}  // namespace dashpot::host
