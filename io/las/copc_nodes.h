// Points of a cloud, in the order of an octree, as the nodes of a Cloud Optimized Point Cloud: each
// level has some points of every place, and those below have what lies between.
//
// A node's cube is divided into 128^3 cells. Of each the first point, in the order of the octree,
// belongs to the node, unless a node above has it; the others belong to nodes below. In that order
// a point is the first of its cell if the point before it is in another one: the node that a point
// belongs to is known from these two points alone.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "io/las/octree_order.h"

namespace lamina {

struct CopcKey {
  std::int32_t level = 0, x = 0, y = 0, z = 0;
};

class CopcNodes {
 public:
  // A node with its records, whole; without any if only nodes below have some. Comes after all
  // nodes below it.
  using Visitor = std::function<void(const CopcKey& key, std::string_view records)>;

  static constexpr int kCellBits = 7;
  // Nodes with more pass further points on to nodes below, so that memory is bounded.
  static constexpr std::size_t kMostPoints = 60'000;
  // Nodes that would have fewer, and none below, leave them to the node above.
  static constexpr std::size_t kFewestPoints = 500;

  // `bits`: the edge of the whole cube is 2^bits units.
  CopcNodes(int bits, std::size_t record_bytes, std::array<std::int32_t, 3> least, Visitor visit);

  // In the order of the octree.
  void Add(std::string_view record);
  void Finish();

 private:
  struct Node {
    std::string records;
    bool has_below = false;  // nodes that were visited
  };

  CopcKey KeyAt(int level) const;
  void Close(int down_to);

  const int bits_;
  const std::size_t record_bytes_;
  const std::array<std::int32_t, 3> least_;
  const Visitor visit_;
  bool any_ = false;
  OctreePlace last_{};
  std::vector<Node> path_;  // by level: the nodes around the last point
};

}  // namespace lamina
