// Where the clusters of keyframes are that are more than memory holds, and where to put what is
// made of them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "core/geometry/packed_cluster.h"

namespace lamina {

// Not thread-safe.
class KeyframeSource {
 public:
  virtual ~KeyframeSource() = default;
  virtual std::size_t size() const = 0;
  // Of one keyframe: LiDAR frame, about its origin, with the weights that they have in the map.
  // The same each time.
  virtual std::vector<PackedCluster> Read(std::size_t keyframe) const = 0;
};

// Bytes that outgrow memory. Not thread-safe.
class ByteSpool {
 public:
  virtual ~ByteSpool() = default;
  // Returns where they are.
  virtual std::uint64_t Append(std::string_view bytes) = 0;
  // What was appended there.
  virtual std::string Read(std::uint64_t at, std::size_t bytes) const = 0;
};
using MakeSpool = std::function<std::unique_ptr<ByteSpool>()>;

}  // namespace lamina
