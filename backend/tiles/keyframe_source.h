// Where the clusters of keyframes are that are more than memory holds, and where to put what is
// made of them.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/byte_store.h"
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

// An empty store for what outgrows memory.
using MakeStore = std::function<std::unique_ptr<ByteStore>()>;

// Throws OutputError if the store does not take the bytes.
StoredBytes PutAside(std::string_view bytes, ByteStore* store);
// Throws OutputError if they are damaged.
std::string TakeBack(const StoredBytes& place, const ByteStore& store);

}  // namespace lamina
