#include "io/las/copc_nodes.h"

#include <algorithm>
#include <utility>

namespace lamina {

CopcNodes::CopcNodes(int bits, std::size_t record_bytes, std::array<std::int32_t, 3> least,
                     Visitor visit)
    : bits_(bits),
      record_bytes_(record_bytes),
      least_(least),
      visit_(std::move(visit)),
      path_(static_cast<std::size_t>(std::max(bits - kCellBits, 0)) + 1) {}

CopcKey CopcNodes::KeyAt(int level) const {
  const auto at = [&](std::size_t axis) {
    return static_cast<std::int32_t>(std::uint64_t{last_[axis]} >> (bits_ - level));
  };
  return {level, at(0), at(1), at(2)};
}

void CopcNodes::Close(int down_to) {
  for (int level = static_cast<int>(path_.size()) - 1; level >= down_to; --level) {
    Node& node = path_[static_cast<std::size_t>(level)];
    if (node.records.empty() && !node.has_below) continue;
    Node* const above = level > 0 ? &path_[static_cast<std::size_t>(level) - 1] : nullptr;
    const bool few = node.records.size() < kFewestPoints * record_bytes_;
    if (above != nullptr && !node.has_below && few &&
        above->records.size() < kMostPoints * record_bytes_) {
      above->records += node.records;
    } else {
      visit_(KeyAt(level), node.records);
      if (above != nullptr) above->has_below = true;
    }
    node.records.clear();
    node.has_below = false;
  }
}

void CopcNodes::Add(std::string_view record) {
  const OctreePlace place = OctreePlaceOf(record.data(), least_);
  // The coarsest level at which the cells of this point and of the last one differ, counting the
  // whole cube as 0.
  int level = 0;
  if (any_) {
    level = bits_ - DifferingBits(place, last_) + 1;
    Close(std::min(level, static_cast<int>(path_.size())));
  }
  any_ = true;
  last_ = place;
  const int deepest = static_cast<int>(path_.size()) - 1;
  int node = std::clamp(level - kCellBits, 0, deepest);
  while (node < deepest &&
         path_[static_cast<std::size_t>(node)].records.size() >= kMostPoints * record_bytes_) {
    ++node;
  }
  path_[static_cast<std::size_t>(node)].records += record;
}

void CopcNodes::Finish() {
  if (any_) Close(0);
}

}  // namespace lamina
