#include "dashpot/detect/candidates.hpp"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "dashpot/detect/narrowing.hpp"
#include "dashpot/lanes/prefetch.hpp"
#include "dashpot/model/contacts.hpp"
#include "dashpot/model/errors.hpp"
#include "dashpot/model/properties.hpp"
#include "dashpot/model/sleep.hpp"

namespace dashpot::host {

namespace {

// Room beyond the reach of a step: steps like the present one, and a fraction of the least
// half-width for geoms that hardly move. Half of both gathers pairs so often that a step of a large
// bin takes 6 % longer; twice the least room keeps so many that it takes 1 % longer.
constexpr double kStepsAhead = 8.0;
constexpr double kLeastRoom = 0.1;
// Pairs kept for each that is near and each geom above which they are gathered anew, where geoms
// are half as fast as then: the step before may have been a fast one.
constexpr size_t kMostKept = 8;
// Pairs and geoms that a thread takes at once.
constexpr int kPairsAtOnce = 256, kGeomsAtOnce = 64;

std::array<double, 12> pose_of(const mjData* d, int geom) {
  std::array<double, 12> pose;
  std::copy_n(d->geom_xpos + 3 * geom, 3, pose.begin());
  std::copy_n(d->geom_xmat + 9 * geom, 9, pose.begin() + 3);
  return pose;
}

// How far from a geom its contacts are detected, of its share.
double around(const mjModel* m, int geom) { return m->geom_margin[geom] + m->geom_gap[geom]; }

BoundingBox box_of(const Room& room) {
  BoundingBox box{{}, {}, {1, 0, 0, 0, 1, 0, 0, 0, 1}};
  for (int i = 0; i < 3; ++i) {
    box.centre[i] = 0.5 * (room.high[i] + room.low[i]);
    box.half[i] = 0.5 * (room.high[i] - room.low[i]);
  }
  return box;
}

bool overlap(const Room& a, const Room& b) {
  for (int i = 0; i < 3; ++i)
    if (a.low[i] > b.high[i] || b.low[i] > a.high[i]) return false;
  return true;
}

}  // namespace

bool CandidatePairs::cover(const mjModel_* m, const mjData_* d) {
  return m->nflex == 0 && !(m->opt.disableflags & mjDSBL_MIDPHASE) && !mjcb_contactfilter &&
         !has_adhesion(m) && d->threadpool == 0 &&
         std::find(m->geom_type, m->geom_type + m->ngeom, mjGEOM_SDF) == m->geom_type + m->ngeom;
}

const std::vector<CandidatePair>& CandidatePairs::near(const mjModel_* m, const mjData_* d,
                                                       const ReachBuffers& buffers,
                                                       Narrowing& narrowing, Team& team) {
  near_.clear();
  if (m->opt.disableflags & (mjDSBL_CONTACT | mjDSBL_CONSTRAINT)) return near_;
  read_filters(m);
  const bool changed = filters_now_ != filters_;
  if (changed) {
    filters_.clear();
    bounded_.clear();
    planes_.clear();
    for (int geom = 0; geom < m->ngeom; ++geom)
      if (may_collide(m, geom))
        (m->geom_type[geom] == mjGEOM_PLANE ? planes_ : bounded_).push_back(geom);
  }
  find_boxes(m, d, team);
  if (changed || is_left(m, d) || are_too_many(buffers.reach)) gather(m, d, buffers);
  const bool any_sleeps = host::any_sleeps(m, d);
  const int count = static_cast<int>(all_.size());
  const int size = team.range_size(count, kPairsAtOnce);
  near_of_range_.resize(count / size + 1);
  for (NearOfRange& range : near_of_range_) {
    range.pairs.clear();
    range.narrowed.clear();
  }
  team.share(count, kPairsAtOnce, [&](int, int first, int last) {
    NearOfRange& found = near_of_range_[first / size];
    for (int i = first; i < last; ++i) {
      if (i + static_cast<int>(kPrefetched) < last)
        for (int geom : all_[i + kPrefetched].geom) prefetch(&present_[geom], sizeof(Room));
      CandidatePair pair = all_[i];
      if (any_sleeps && rest_asleep(m, d, pair.geom)) continue;
      pair.within = margin_of(m, pair) + gap_of(m, pair);
      if (!are_near(m, d, pair)) continue;
      const double before =
          std::exchange(pair.within, narrowing.within(m, d, pair, found.narrowed));
      if (pair.within == before || are_near(m, d, pair)) found.pairs.push_back(pair);
    }
  });
  std::vector<NarrowedPair>& narrowed = narrowing.pairs();
  for (const NearOfRange& range : near_of_range_) {
    near_.insert(near_.end(), range.pairs.begin(), range.pairs.end());
    narrowed.insert(narrowed.end(), range.narrowed.begin(), range.narrowed.end());
  }
  return near_;
}

void CandidatePairs::forget() {
  filters_.clear();
  joint_gaps_.forget();
}

void CandidatePairs::read_filters(const mjModel_* m) {
  filters_now_.assign(1, m->opt.disableflags);
  const auto append = [&](const int* values, auto count) {
    filters_now_.insert(filters_now_.end(), values, values + count);
  };
  for (const int* of_geoms : {m->geom_type, m->geom_contype, m->geom_conaffinity})
    append(of_geoms, m->ngeom);
  for (const int* of_bodies : {m->body_contype, m->body_conaffinity}) append(of_bodies, m->nbody);
  for (const int* of_pairs : {m->pair_geom1, m->pair_geom2}) append(of_pairs, m->npair);
  append(m->exclude_signature, m->nexclude);
}

bool CandidatePairs::are_too_many(const std::vector<double>& reach) const {
  return all_.size() > kMostKept * (near_.size() + bounded_.size()) &&
         std::accumulate(reach.begin(), reach.end(), 0.0) < 0.5 * reach_;
}

void CandidatePairs::find_boxes(const mjModel_* m, const mjData_* d, Team& team) {
  boxes_.resize(m->ngeom);
  present_.resize(m->ngeom);
  team.for_each(static_cast<int>(bounded_.size()), kGeomsAtOnce, [&](int i) {
    const int geom = bounded_[i];
    BoundingBox& box = boxes_[geom] = bounding_box(m, d, geom);
    Room& room = present_[geom];
    for (int axis = 0; axis < 3; ++axis) {
      double wide = around(m, geom);
      for (int j = 0; j < 3; ++j) wide += box.half[j] * std::abs(box.rotation[3 * axis + j]);
      room.low[axis] = box.centre[axis] - wide;
      room.high[axis] = box.centre[axis] + wide;
    }
  });
}

bool CandidatePairs::is_left(const mjModel_* m, const mjData_* d) const {
  for (int geom : bounded_)
    for (int i = 0; i < 3; ++i)
      if (!(present_[geom].low[i] >= rooms_[geom].low[i] &&
            present_[geom].high[i] <= rooms_[geom].high[i]))
        return true;
  for (size_t i = 0; i < planes_.size(); ++i)
    if (pose_of(d, planes_[i]) != as_gathered_[i].pose ||
        !(around(m, planes_[i]) <= as_gathered_[i].around))
      return true;
  return false;
}

void CandidatePairs::gather(const mjModel_* m, const mjData_* d, const ReachBuffers& buffers) {
  const std::vector<double>& reach = buffers.reach;
  filters_.clear();  // until all pairs are there
  rooms_ = present_;
  check_places(m, d);
  for (int geom : bounded_) {
    if (!moves_and_collides(m, geom)) continue;
    const double* half = boxes_[geom].half;
    const double more = std::min<double>(
        std::max(kStepsAhead * reach[geom], kLeastRoom * std::min({half[0], half[1], half[2]})),
        mjMAXVAL);
    for (int i = 0; i < 3; ++i) {
      rooms_[geom].low[i] -= more;
      rooms_[geom].high[i] += more;
    }
  }
  all_.clear();
  for (int defined = 0; defined < m->npair; ++defined) {
    const CandidatePair pair = pair_of(m, m->pair_geom1[defined], m->pair_geom2[defined], defined);
    if (have_collision(m, pair)) all_.push_back(pair);
  }
  gather_of_planes(m, d, buffers);
  gather_of_rooms(m, d, buffers);
  std::sort(all_.begin(), all_.end(), comes_before);
  reach_ = std::accumulate(reach.begin(), reach.end(), 0.0);
  filters_ = filters_now_;
}

// Comparisons with what is no number would leave pairs out in silence.
void CandidatePairs::check_places(const mjModel* m, const mjData* d) const {
  const auto check = [&](int geom, const auto& numbers) {
    for (double number : numbers)
      if (!std::isfinite(number))
        throw std::runtime_error("geom " + named(m, mjOBJ_GEOM, geom) +
                                 " has no finite place: of its position, rotation, size, margin "
                                 "and speed not all are finite");
  };
  for (int geom : bounded_) {
    check(geom, present_[geom].low);
    check(geom, present_[geom].high);
  }
  for (int plane : planes_) check(plane, pose_of(d, plane));
}

void CandidatePairs::gather_of_planes(const mjModel_* m, const mjData_* d,
                                      const ReachBuffers& buffers) {
  as_gathered_.clear();
  for (int plane : planes_) {
    as_gathered_.push_back({pose_of(d, plane), around(m, plane)});
    for (int geom : bounded_)
      if (height_over_plane(d, plane, box_of(rooms_[geom])) <= around(m, plane))
        add(m, d, plane, geom, buffers);
  }
}

// Sweeps along the axis over which the rooms are spread most.
void CandidatePairs::gather_of_rooms(const mjModel_* m, const mjData_* d,
                                     const ReachBuffers& buffers) {
  double spread[3];
  for (int i = 0; i < 3; ++i) {
    double sum = 0.0, squares = 0.0;
    for (int geom : bounded_) {
      const double middle = boxes_[geom].centre[i];
      sum += middle;
      squares += middle * middle;
    }
    spread[i] = squares * bounded_.size() - sum * sum;
  }
  const auto axis = std::max_element(spread, spread + 3) - spread;
  order_ = bounded_;
  std::sort(order_.begin(), order_.end(),
            [&](int a, int b) { return rooms_[a].low[axis] < rooms_[b].low[axis]; });
  for (size_t i = 0; i < order_.size(); ++i) {
    const Room& room = rooms_[order_[i]];
    for (size_t j = i + 1; j < order_.size(); ++j) {
      const Room& other = rooms_[order_[j]];
      if (other.low[axis] > room.high[axis]) break;
      if (overlap(room, other)) add(m, d, order_[i], order_[j], buffers);
    }
  }
}

void CandidatePairs::add(const mjModel_* m, const mjData_* d, int geom1, int geom2,
                         const ReachBuffers& buffers) {
  const CandidatePair pair = pair_of(m, std::min(geom1, geom2), std::max(geom1, geom2), -1);
  if (may_meet(m, geom1, geom2) && have_collision(m, pair) && defining_pair(m, geom1, geom2) < 0 &&
      !joint_gaps_.keep_apart(m, d, geom1, geom2,
                              margin_of(m, pair) + buffers.own_gap(pair.geom, -1)))
    all_.push_back(pair);
}

bool CandidatePairs::are_near(const mjModel_* m, const mjData_* d,
                              const CandidatePair& pair) const {
  const int geom1 = pair.geom[0], geom2 = pair.geom[1];
  if (m->geom_type[geom1] == mjGEOM_PLANE)
    return height_over_plane(d, geom1, boxes_[geom2]) <= pair.within;
  if (pair.defined < 0 && !overlap(present_[geom1], present_[geom2])) return false;
  const double between = m->geom_rbound[geom1] + m->geom_rbound[geom2] + pair.within;
  mjtNum apart[3];
  mju_sub3(apart, d->geom_xpos + 3 * geom1, d->geom_xpos + 3 * geom2);
  if (mju_dot3(apart, apart) > between * between) return false;
  return m->geom_type[geom1] == mjGEOM_SPHERE ||
         boxes_apart(boxes_[geom1], boxes_[geom2]) <= pair.within;
}

}  // namespace dashpot::host
