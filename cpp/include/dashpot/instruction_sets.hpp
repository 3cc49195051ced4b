// Functions compiled for several instruction sets, of which the processor's best is taken when the
// library is loaded. Nothing is fused or reordered, so all give the same bits.

#pragma once

#if defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__)
#define DASHPOT_VECTOR_CLONES [[gnu::target_clones("default", "avx2")]]
#else
#define DASHPOT_VECTOR_CLONES
#endif
