// Finds remembered contacts by their geom pair, and by where they are.

#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace dashpot {

// Squared distance (m^2) of two points.
inline double squared_distance(const double* a, const double* b) {
  double sum = 0.0;
  for (int i = 0; i < 3; ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return sum;
}

// A geom pair as one number.
inline std::uint64_t pair_key(int geom1, int geom2) {
  return static_cast<std::uint64_t>(static_cast<std::uint32_t>(geom1)) << 32 |
         static_cast<std::uint32_t>(geom2);
}

// Finds the slots of a geom pair, in their order: chains by the hash of the pair.
class SlotsByPair {
 public:
  // Appends a chain's slots in front, so they are to be added from the last one down.
  void reset(int slots) {
    bits_ = 1;
    while ((1 << bits_) < 2 * slots) ++bits_;
    first_.assign(size_t{1} << bits_, -1);
    next_.resize(slots);
    key_.resize(slots);
  }
  void add(std::uint64_t pair, int slot) {
    int& first = first_[bucket(pair)];
    key_[slot] = pair;
    next_[slot] = first;
    first = slot;
  }
  template <typename Visit>
  void for_each(std::uint64_t pair, const Visit& visit) const {
    for (int slot = first_[bucket(pair)]; slot >= 0; slot = next_[slot])
      if (key_[slot] == pair) visit(slot);
  }

 private:
  // Fibonacci hashing: multiplication by 2^64 over the golden ratio.
  size_t bucket(std::uint64_t pair) const { return pair * 0x9E3779B97F4A7C15u >> (64 - bits_); }

  int bits_ = 1;
  std::vector<int> first_, next_;
  std::vector<std::uint64_t> key_;
};

}  // namespace dashpot
