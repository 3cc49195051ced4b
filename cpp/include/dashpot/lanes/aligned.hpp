// Arrays that begin at a cache line: a free body's coordinates then fill exactly one, and loading
// four of them never touches two.

#pragma once

#include <cstddef>
#include <new>
#include <vector>

namespace dashpot {

inline constexpr std::size_t kCacheLine = 64;  // bytes

template <typename T>
struct CacheAligned {
  using value_type = T;
  CacheAligned() = default;
  template <typename U>
  CacheAligned(const CacheAligned<U>&) {}
  T* allocate(std::size_t count) {
    return static_cast<T*>(::operator new (count * sizeof(T), std::align_val_t{kCacheLine}));
  }
  void deallocate(T* memory, std::size_t) {
    ::operator delete (memory, std::align_val_t{kCacheLine});
  }
  bool operator==(const CacheAligned&) const { return true; }
  bool operator!=(const CacheAligned&) const { return false; }
};

using AlignedDoubles = std::vector<double, CacheAligned<double>>;

}  // namespace dashpot
