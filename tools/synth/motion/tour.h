// A closed way through the streets of a bounded town: a random walk that never turns on the spot,
// and the shortest way back to where it began. Streets are driven several times, in both
// directions.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace lamina::synth {

// Along some blocks, then around a corner: +1 left, -1 right, 0 straight on.
struct RouteLeg {
  int blocks = 0, turn_after = 0;
};

struct Tour {
  Eigen::Vector2i start = Eigen::Vector2i::Zero();  // crossing, from 0
  int quarter = 0;                                  // heading there, in quarter turns
  std::vector<RouteLeg> legs;                       // each ends with a turn, the last one too
};

// Of `blocks` blocks or a few more, among (size + 1)^2 crossings. size >= 1, blocks >= 1. Pure
// function.
Tour MakeTour(int size, int blocks, std::uint64_t key);

}  // namespace lamina::synth
