// Memory asked for ahead of its use. Loops over contacts and pairs come to their bodies and geoms
// in no order; where these do not fit into the processor's first caches, waiting for each of them
// would take as long as the work.

#pragma once

#include <cstddef>

#include "dashpot/lanes/aligned.hpp"

namespace dashpot {

// How many contacts or pairs ahead.
inline constexpr std::size_t kPrefetched = 4;

inline void prefetch(const void* memory, std::size_t bytes) {
  for (std::size_t at = 0; at < bytes; at += kCacheLine)
    __builtin_prefetch(static_cast<const char*>(memory) + at);
}

}  // namespace dashpot
