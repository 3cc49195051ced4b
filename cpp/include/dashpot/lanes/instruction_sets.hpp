// Functions compiled for several instruction sets, of which the processor's best is taken when the
// library is loaded. Nothing is fused or reordered, so all give the same bits.

#pragma once

// What chooses at loading runs before the runtime of a sanitizer is there: none then.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define DASHPOT_SANITIZED
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(memory_sanitizer) || \
    __has_feature(thread_sanitizer)
#define DASHPOT_SANITIZED
#endif
#endif

// Clang does not link functions of the same name in unnamed namespaces of several files.
#if defined(__x86_64__) && !defined(DASHPOT_SANITIZED) && !defined(__clang__)
#define DASHPOT_VECTOR_CLONES [[gnu::target_clones("default", "avx2")]]
#else
#define DASHPOT_VECTOR_CLONES
#endif
