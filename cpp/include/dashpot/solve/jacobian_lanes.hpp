// Jacobians of four groups of rows at once, and their products with motions and impulses.
//
// Free bodies are gathered by transposing their coordinates, four numbers each, into lanes, and
// scattered to the other way round, one lane after the other, so that the order of sums is fixed.

#pragma once

#include <algorithm>

#include "dashpot/lanes/lanes.hpp"
#include "dashpot/rows/trees.hpp"

namespace dashpot {

// The Jacobian of four contacts between free bodies.
struct PairLanes {
  Lanes frame[9], arm[2][3];
  // Coordinates; lanes to spare act on the ground, each on its own.
  int body[2][kLanes] = {{0, kBodyCoordinates, 2 * kBodyCoordinates, 3 * kBodyCoordinates},
                         {0, kBodyCoordinates, 2 * kBodyCoordinates, 3 * kBodyCoordinates}};
};
static_assert(kGroundCoordinates == kLanes * kBodyCoordinates);

// The Jacobian of four rows of one coordinate each, as limits and dry friction of hinges and slides
// have; lanes to spare act on the ground.
struct JointLanes {
  Lanes value;
  int column[kLanes];
};

// The Jacobian of four groups of sparse rows; lanes to spare have none. Values are stored by runs
// of four coordinates, each row after row, with zeros where there is no column, and, of several
// rows, column by column, each four (or eight) rows.
struct SparseLanes {
  const double *by_run[kLanes], *by_column[kLanes];
  const int *start[kLanes], *column[kLanes];
  int runs[kLanes], width[kLanes];
  int common_width = 0;  // columns for which every lane has values, of its own or zeros
};
// Numbers that `dim` rows of `width` values take in both orders, at most.
inline constexpr int sparse_size(int dim, int width) {
  return (dim * kLanes + padded(dim)) * width;
}
// Fills one lane with `dim` rows of `width` values, which are stored in `room`: sparse_size zeros.
// `start`: room for as many numbers as there are columns.
inline void pack_sparse(const double* value, const int* column, int dim, int width, double* room,
                        int* start, int lane, SparseLanes& j) {
  double* by_column = room + dim * kLanes * width;
  for (int k = 0; k < width; ++k)
    for (int i = 0; i < dim && dim > 1; ++i) by_column[k * padded(dim) + i] = value[i * width + k];
  int runs = 0;
  for (int k = 0; k < width; ++runs) {
    int last = k;
    while (last + 1 < width && column[last + 1] > column[last] &&
           column[last + 1] < column[k] + kLanes)
      ++last;
    // No run reaches coordinates of a tree that it does not move: these begin at such multiples.
    const int aligned = column[k] / kLanes * kLanes;
    start[runs] = column[last] < aligned + kLanes ? aligned : column[k];
    for (; k <= last; ++k)
      for (int i = 0; i < dim; ++i)
        room[(runs * dim + i) * kLanes + column[k] - start[runs]] = value[i * width + k];
  }
  j.by_run[lane] = room;
  j.start[lane] = start;
  j.runs[lane] = runs;
  j.by_column[lane] = by_column;
  j.column[lane] = column;
  j.width[lane] = width;
  j.common_width = lane == kLanes - 1 ? *std::min_element(j.width, j.width + kLanes) : 0;
}
// Gives the lanes after `last` `zeros` in the sums of the others, padded(dim) for each column.
inline void spare_sparse(const double* zeros, int last, SparseLanes& j) {
  j.common_width = *std::min_element(j.width, j.width + last + 1);
  for (int lane = last + 1; lane < kLanes; ++lane) {
    j.by_column[lane] = zeros;
    j.column[lane] = j.column[0];
  }
}

[[gnu::always_inline]] static inline void cross(const Lanes* a, const Lanes* b, Lanes* out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

[[gnu::always_inline]] static inline Lanes dot(const Lanes* a, const Lanes* b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Linear and angular coordinates of four bodies.
[[gnu::always_inline]] static inline void load_bodies(const double* motion, const int* body,
                                                      Lanes (&linear)[kLanes],
                                                      Lanes (&angular)[kLanes]) {
  for (int lane = 0; lane < kLanes; ++lane) {
    linear[lane] = load_lanes(motion + body[lane]);
    angular[lane] = load_lanes(motion + body[lane] + 4);
  }
  transpose(linear);
  transpose(angular);
}

// Adds to the second bodies of four pairs, takes from the first.
template <int Side>
[[gnu::always_inline]] static inline void apply_to_bodies(Lanes (&linear)[kLanes],
                                                          Lanes (&angular)[kLanes], const int* body,
                                                          double* force) {
  const auto apply = [](const Lanes& term, double* at) __attribute__((always_inline)) {
    const Lanes before = load_lanes(at);
    store_lanes(Side == 0 ? before - term : before + term, at);
  };
  transpose(linear);
  transpose(angular);
  for (int lane = 0; lane < kLanes; ++lane) {
    apply(linear[lane], force + body[lane]);
    apply(angular[lane], force + body[lane] + 4);
  }
}

// out = J motion.
template <int Dim>
[[gnu::always_inline]] static inline void gather(const PairLanes& j, const double* motion,
                                                 Lanes* out) {
  Lanes v1[kLanes], w1[kLanes], v2[kLanes], w2[kLanes], at1[3], at2[3], relative[3];
  load_bodies(motion, j.body[0], v1, w1);
  load_bodies(motion, j.body[1], v2, w2);
  cross(w1, j.arm[0], at1);
  cross(w2, j.arm[1], at2);
  for (int i = 0; i < 3; ++i) relative[i] = (v2[i] + at2[i]) - (v1[i] + at1[i]);
  for (int i = 0; i < std::min(Dim, 3); ++i) out[i] = dot(j.frame + 3 * i, relative);
  if (Dim <= 3) return;
  for (int i = 0; i < 3; ++i) relative[i] = w2[i] - w1[i];
  for (int i = 3; i < Dim; ++i) out[i] = dot(j.frame + 3 * (i - 3), relative);
}

// The sum of `count` impulses along the directions of a frame.
[[gnu::always_inline]] static inline void sum_along(const Lanes* frame, const Lanes* impulse,
                                                    int count, Lanes* sum) {
  for (int k = 0; k < 3; ++k) {
    sum[k] = frame[k] * impulse[0];
    for (int i = 1; i < count; ++i) sum[k] += frame[3 * i + k] * impulse[i];
  }
}

// force += J' impulse.
template <int Dim>
[[gnu::always_inline]] static inline void scatter(const PairLanes& j, const Lanes* impulse,
                                                  double* force) {
  Lanes linear[2][kLanes] = {}, angular[2][kLanes] = {};
  sum_along(j.frame, impulse, std::min(Dim, 3), linear[0]);
  for (int side = 0; side < 2; ++side) cross(j.arm[side], linear[0], angular[side]);
  if constexpr (Dim > 3) {
    Lanes torque[3];
    sum_along(j.frame, impulse + 3, Dim - 3, torque);
    for (int side = 0; side < 2; ++side)
      for (int k = 0; k < 3; ++k) angular[side][k] += torque[k];
  }
  std::copy_n(linear[0], 3, linear[1]);
  apply_to_bodies<0>(linear[0], angular[0], j.body[0], force);
  apply_to_bodies<1>(linear[1], angular[1], j.body[1], force);
}

template <int Dim>
[[gnu::always_inline]] static inline void gather(const JointLanes& j, const double* motion,
                                                 Lanes* out) {
  static_assert(Dim == 1);
  const Lanes at{motion[j.column[0]], motion[j.column[1]], motion[j.column[2]],
                 motion[j.column[3]]};
  out[0] = j.value * at;
}

template <int Dim>
[[gnu::always_inline]] static inline void scatter(const JointLanes& j, const Lanes* impulse,
                                                  double* force) {
  static_assert(Dim == 1);
  const Lanes generalized = j.value * impulse[0];
  for (int lane = 0; lane < kLanes; ++lane) force[j.column[lane]] += generalized[lane];
}

// The sums of the lanes do not wait for each other.
template <int Dim>
[[gnu::always_inline]] static inline void gather(const SparseLanes& j, const double* motion,
                                                 Lanes* out) {
  constexpr int kParts = padded(Dim) / kLanes;
  Lanes sum[kParts][kLanes] = {};
  if constexpr (Dim == 1) {
    for (int lane = 0; lane < kLanes; ++lane)
      for (int run = 0; run < j.runs[lane]; ++run)
        sum[0][lane] +=
            load_lanes(j.by_run[lane] + run * kLanes) * load_lanes(motion + j.start[lane][run]);
    transpose(sum[0]);
    out[0] = (sum[0][0] + sum[0][1]) + (sum[0][2] + sum[0][3]);
    return;
  }
  const auto add_column = [&](int lane, int k) __attribute__((always_inline)) {
    const double* value = j.by_column[lane] + k * kParts * kLanes;
    const double of_column = motion[j.column[lane][k]];
    for (int part = 0; part < kParts; ++part)
      sum[part][lane] += load_lanes(value + part * kLanes) * of_column;
  };
  for (int k = 0; k < j.common_width; ++k)
    for (int lane = 0; lane < kLanes; ++lane) add_column(lane, k);
  for (int lane = 0; lane < kLanes; ++lane)
    for (int k = j.common_width; k < j.width[lane]; ++k) add_column(lane, k);
  for (int part = 0; part < kParts; ++part) {
    transpose(sum[part]);
    for (int row = 0; row < kLanes && part * kLanes + row < Dim; ++row)
      out[part * kLanes + row] = sum[part][row];
  }
}

// Of several impulses.
template <int Dim, int Count>
[[gnu::always_inline]] static inline void scatter_all(const SparseLanes& j,
                                                      const Lanes* const (&impulse)[Count],
                                                      double* const (&force)[Count]) {
  for (int lane = 0; lane < kLanes; ++lane)
    for (int run = 0; run < j.runs[lane]; ++run) {
      Lanes sum[Count] = {};
      for (int row = 0; row < Dim; ++row) {
        const Lanes of_row = load_lanes(j.by_run[lane] + (run * Dim + row) * kLanes);
        for (int i = 0; i < Count; ++i) sum[i] += of_row * impulse[i][row][lane];
      }
      for (int i = 0; i < Count; ++i) {
        double* at = force[i] + j.start[lane][run];
        store_lanes(load_lanes(at) + sum[i], at);
      }
    }
}

template <int Dim>
[[gnu::always_inline]] static inline void scatter(const SparseLanes& j, const Lanes* impulse,
                                                  double* force) {
  scatter_all<Dim, 1>(j, {impulse}, {force});
}

template <int Dim, typename Jacobian>
[[gnu::always_inline]] static inline void scatter_two(const Jacobian& j, const Lanes* first,
                                                      const Lanes* second, double* to_first,
                                                      double* to_second) {
  scatter<Dim>(j, first, to_first);
  scatter<Dim>(j, second, to_second);
}

template <int Dim>
[[gnu::always_inline]] static inline void scatter_two(const SparseLanes& j, const Lanes* first,
                                                      const Lanes* second, double* to_first,
                                                      double* to_second) {
  scatter_all<Dim, 2>(j, {first, second}, {to_first, to_second});
}

}  // namespace dashpot
