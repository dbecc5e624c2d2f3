// Functions that are compiled for several kinds of processor.
//
//     LAMINA_FOR_EACH_PROCESSOR
//     void Sum(const double* values, std::size_t count) { ... }
//
// The kind is chosen when the program starts, so that the program runs on every machine. The wider
// one does the same additions and multiplications in the same order, none of them fused: results
// are the same bits.
#pragma once

#include <cstdint>

namespace lamina {

// Four numbers, of which a processor without AVX makes two and two; a comparison of them gives four
// integers, each with all of its bits set or none.
using Four = double __attribute__((vector_size(32)));
using FourIntegers = std::int64_t __attribute__((vector_size(32)));
using FourFloats = float __attribute__((vector_size(16)));

}  // namespace lamina

// Sanitizers are not ready at the time of the choice.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define LAMINA_FOR_EACH_PROCESSOR __attribute__((target_clones("avx2", "default")))
#else
#define LAMINA_FOR_EACH_PROCESSOR
#endif
