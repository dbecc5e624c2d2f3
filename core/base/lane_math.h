// Functions of four numbers at once, for loops that are compiled for several kinds of processor
// (core/base/processor.h): the same bits on each of them, whatever its mathematical library is.
// Lanes do not touch one another.
#pragma once

#include <cmath>
#include <cstdint>

#include "core/base/processor.h"

namespace lamina {

[[gnu::always_inline]] inline bool AnyLane(FourIntegers bits) {
  return (bits[0] | bits[1] | bits[2] | bits[3]) != 0;
}

[[gnu::always_inline]] inline void SquareRoots(Four* x) {
  *x = Four{std::sqrt((*x)[0]), std::sqrt((*x)[1]), std::sqrt((*x)[2]), std::sqrt((*x)[3])};
}

// Natural logarithms of positive normal numbers, to 1e-10: with x = 2^k m, m in [sqrt(1/2),
// sqrt(2)) and s = (m - 1) / (m + 1),
//
//     log x = k log 2 + 2 (s + s^3 / 3 + s^5 / 5 + ...),    |s| < 0.172.
[[gnu::always_inline]] inline void Logarithms(Four* x) {
  constexpr std::int64_t kMantissa = (std::int64_t{1} << 52) - 1;
  constexpr std::int64_t kOne = std::int64_t{1023} << 52;
  // A double whose last bits are an integer: 2^52 more than that.
  constexpr std::int64_t kInteger = std::int64_t{1075} << 52;
  constexpr double kIntegerAndBias = 4503599627370496.0 + 1023.0;
  constexpr double kRootOfTwo = 1.4142135623730951, kLogOfTwo = 0.6931471805599453;
  const auto bits = reinterpret_cast<FourIntegers>(*x);
  const auto half = reinterpret_cast<Four>((bits & kMantissa) | kOne);
  Four power = reinterpret_cast<Four>((bits >> 52) | kInteger) - kIntegerAndBias;
  const FourIntegers upper = half > kRootOfTwo;
  const Four m = upper ? 0.5 * half : half;
  power = upper ? power + 1.0 : power;
  const Four s = (m - 1.0) / (m + 1.0), s2 = s * s;
  const Four series =
      1.0 + s2 * (1.0 / 3 + s2 * (1.0 / 5 + s2 * (1.0 / 7 + s2 * (1.0 / 9 + s2 * (1.0 / 11)))));
  *x = power * kLogOfTwo + 2.0 * s * series;
}

}  // namespace lamina
