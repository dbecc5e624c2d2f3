// Which frames see planes together or have a prior between them: the 6x6 blocks of the normal
// equations that are not zero.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "backend/bundle/index.h"
#include "backend/bundle/problem.h"

namespace lamina {

class BlockPattern {
 public:
  BlockPattern(const BundleProblem& problem, const BundleIndex& index);
  std::size_t frames() const { return partners_.size(); }
  // Frames k <= frame that share a plane or a prior with it, ascending; itself is the last.
  const std::vector<std::int32_t>& partners(std::size_t frame) const { return partners_[frame]; }
  // Share of the blocks on and below the diagonal that are not zero.
  double Density() const;

 private:
  std::vector<std::vector<std::int32_t>> partners_;
};

}  // namespace lamina
