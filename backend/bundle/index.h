// The observations of a bundle problem sorted by frame, beside the problem's own order by plane.
//
// A pass over frames writes only to that frame's part of the normal equations: it needs no partial
// sums, and so gives the same bits at any number of threads.
#pragma once

#include <cstdint>
#include <vector>

#include "backend/bundle/problem.h"

namespace lamina {

class BundleIndex {
 public:
  struct Entry {
    std::int32_t observation, plane;
  };

  // Throws std::logic_error if an observation names a pose that does not exist, or if the frames of
  // a plane do not ascend.
  explicit BundleIndex(const BundleProblem& problem);

  std::size_t frames() const { return first_.size() - 1; }
  const Entry* begin(std::size_t frame) const { return entries_.data() + first_[frame]; }
  const Entry* end(std::size_t frame) const { return entries_.data() + first_[frame + 1]; }
  // The frame of each observation.
  const std::int32_t* observed_by() const { return observed_by_.data(); }

 private:
  std::vector<Entry> entries_;
  std::vector<std::int32_t> observed_by_;
  std::vector<std::size_t> first_;  // of each frame, in entries_; one more at the end
};

}  // namespace lamina
