// A tree of bounding boxes over primitives, for rays and for nearest surfaces.
//
// Each node has up to four children, whose boxes are tested at once in SIMD registers. Built top
// down by the surface area heuristic: a split at which child c holds n_c primitives in a box of
// area A_c costs sum_c A_c n_c, the expected number of tests for a random ray.
//
// Immutable after construction: thread-safe.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "tools/synth/engine/primitive.h"

namespace lamina::synth {

class PrimitiveTree {
 public:
  PrimitiveTree() = default;
  explicit PrimitiveTree(std::vector<Primitive> primitives);

  // The primitive that the ray meets first, nearer than *range, which is then set to its range; or
  // null, and *range stays.
  const Primitive* ClosestHit(const Ray& ray, float* range) const;

  // Distance from a point to the nearest surface, or `bound` where nothing is nearer.
  float Distance(const Eigen::Vector3f& point, float bound) const;

  const Bounds& bounds() const { return bounds_; }
  std::size_t size() const { return primitives_.size(); }

 private:
  // Child i is a node if count[i] == 0, otherwise the primitives first[i], ... An unused child has
  // an inside-out box that nothing meets.
  struct Node {
    std::array<std::array<Eigen::Array4f, 3>, 2> box;  // [low, high][x, y, z]
    std::array<std::int32_t, 4> first;
    std::array<std::int32_t, 4> count;
  };
  class Builder;

  std::vector<Primitive> primitives_;
  std::vector<Node> nodes_;
  Bounds bounds_;
};

}  // namespace lamina::synth
