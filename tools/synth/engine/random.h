// Random numbers that are functions of what they are for.
//
// A synthetic scene must come out the same whichever thread asks for which part of it first, so
// nothing draws from a shared stream: every number is a hash of a key, e.g. (seed, frame, ray) or
// (seed, block x, block y). All functions are pure; a HashStream belongs to one thread.
#pragma once

#include <cmath>
#include <cstdint>
#include <initializer_list>

namespace lamina::synth {

// A bijection of 64 bits in which every bit of the result depends on every bit of x.
inline std::uint64_t ScrambleBits(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

// Hash of a tuple; the order of the parts matters.
inline std::uint64_t HashOf(std::initializer_list<std::int64_t> parts) {
  std::uint64_t h = 0;
  for (const std::int64_t part : parts) h = ScrambleBits(h ^ static_cast<std::uint64_t>(part));
  return h;
}

// Uniform in [0, 1) from the upper bits of a hash.
inline double UniformFrom(std::uint64_t hash) {
  return static_cast<double>(hash >> 11) * 0x1.0p-53;
}

// Standard normal from one hash (Box and Muller's transform of its two halves).
inline float GaussianFrom(std::uint64_t hash) {
  const float u = (static_cast<float>(hash >> 40) + 0.5F) * 0x1.0p-24F;
  const float v = static_cast<float>((hash >> 8) & 0xffffffU) * 0x1.0p-24F;
  return std::sqrt(-2.0F * std::log(u)) * std::cos(6.2831853F * v);
}

// A sequence of numbers that depends on its key alone.
class HashStream {
 public:
  explicit HashStream(std::uint64_t key) : state_(key) {}

  double Uniform() { return UniformFrom(ScrambleBits(state_ += 0x632be59bd9b4e019ULL)); }
  double Uniform(double low, double high) { return low + (high - low) * Uniform(); }
  // One of 0, ..., count - 1.
  int Index(int count) { return static_cast<int>(Uniform() * count); }
  bool Chance(double probability) { return Uniform() < probability; }

 private:
  std::uint64_t state_;
};

inline float Draw(HashStream* random, double low, double high) {
  return static_cast<float>(random->Uniform(low, high));
}

}  // namespace lamina::synth
