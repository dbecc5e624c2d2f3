#include "tools/synth/engine/bvh.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace lamina::synth {
namespace {

constexpr int kLeafSize = 4;
constexpr int kBins = 12;
constexpr int kMaxStack = 128;

struct StackEntry {
  std::int32_t first;
  std::int32_t count;
  float range;
};

// Pending children, nearest on top.
class Stack {
 public:
  bool Empty() const { return size_ == 0; }
  StackEntry Pop() { return entries_[static_cast<std::size_t>(--size_)]; }
  void Push(const StackEntry& entry) { entries_[static_cast<std::size_t>(size_++)] = entry; }

  // Pushes the children whose `key` is below `bound`, so that the smallest key is popped first.
  template <typename Node>
  void PushChildren(const Node& node, const Eigen::Array4f& key, float bound) {
    const int base = size_;
    for (int c = 0; c < 4; ++c) {
      if (!(key[c] < bound)) continue;
      const auto i = static_cast<std::size_t>(c);
      int slot = size_++;
      while (slot > base && entries_[static_cast<std::size_t>(slot - 1)].range < key[c]) {
        entries_[static_cast<std::size_t>(slot)] = entries_[static_cast<std::size_t>(slot - 1)];
        --slot;
      }
      entries_[static_cast<std::size_t>(slot)] = {node.first[i], node.count[i], key[c]};
    }
  }

 private:
  std::array<StackEntry, kMaxStack> entries_;
  int size_ = 0;
};

}  // namespace

class PrimitiveTree::Builder {
 public:
  explicit Builder(PrimitiveTree* tree) : tree_(*tree) {
    const std::size_t size = tree_.primitives_.size();
    boxes_.reserve(size);
    for (const Primitive& p : tree_.primitives_) boxes_.push_back(BoundsOf(p));
    order_.resize(size);
    std::iota(order_.begin(), order_.end(), 0);
  }

  void Build() {
    const Range all = MakeRange(0, static_cast<int>(order_.size()));
    tree_.bounds_ = all.bounds;
    if (all.Size() > 0) BuildNode(all);
    std::vector<Primitive> sorted;
    sorted.reserve(order_.size());
    for (const int i : order_) sorted.push_back(tree_.primitives_[static_cast<std::size_t>(i)]);
    tree_.primitives_ = std::move(sorted);
  }

 private:
  struct Range {
    int begin = 0, end = 0;
    Bounds bounds;
    int Size() const { return end - begin; }
  };

  const Bounds& BoxAt(int place) const {
    return boxes_[static_cast<std::size_t>(order_[static_cast<std::size_t>(place)])];
  }

  static float Centre(const Bounds& box, int axis) {
    return 0.5F * (box.low[axis] + box.high[axis]);
  }

  Range MakeRange(int begin, int end) const {
    Range range{begin, end, {}};
    for (int i = begin; i < end; ++i) range.bounds.Add(BoxAt(i));
    return range;
  }

  // Splits the child of the largest area, again and again, until there are four.
  std::int32_t BuildNode(const Range& range) {
    std::vector<Range> children = {range};
    while (children.size() < 4) {
      Range* largest = nullptr;
      for (Range& child : children) {
        if (child.Size() <= kLeafSize) continue;
        if (!largest || child.bounds.HalfArea() > largest->bounds.HalfArea()) largest = &child;
      }
      if (!largest) break;
      const int middle = Split(*largest);
      const Range upper = MakeRange(middle, largest->end);
      *largest = MakeRange(largest->begin, middle);
      children.push_back(upper);
    }
    const auto index = tree_.nodes_.size();
    tree_.nodes_.emplace_back();
    Node node;
    for (int axis = 0; axis < 3; ++axis) {
      node.box[0][static_cast<std::size_t>(axis)].setConstant(1e30F);
      node.box[1][static_cast<std::size_t>(axis)].setConstant(-1e30F);
    }
    node.first.fill(0);
    node.count.fill(0);
    for (std::size_t c = 0; c < children.size(); ++c) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto row = static_cast<Eigen::Index>(axis);
        node.box[0][axis][static_cast<Eigen::Index>(c)] = children[c].bounds.low[row];
        node.box[1][axis][static_cast<Eigen::Index>(c)] = children[c].bounds.high[row];
      }
      const bool leaf = children[c].Size() <= kLeafSize;
      node.count[c] = leaf ? children[c].Size() : 0;
      node.first[c] = leaf ? children[c].begin : BuildNode(children[c]);
    }
    tree_.nodes_[index] = node;
    return static_cast<std::int32_t>(index);
  }

  // Reorders the range and returns the place of the cut, strictly inside.
  int Split(const Range& range) {
    Bounds centres;
    for (int i = range.begin; i < range.end; ++i) {
      const Eigen::Array3f c = 0.5F * (BoxAt(i).low + BoxAt(i).high);
      centres.Add({c, c});
    }
    int axis = 0;
    (centres.high - centres.low).maxCoeff(&axis);
    const float low = centres.low[axis];
    const float extent = centres.high[axis] - low;
    const auto begin = order_.begin() + range.begin;
    const auto end = order_.begin() + range.end;
    if (extent > 0.0F) {
      const auto bin_of = [&](const Bounds& box) {
        return std::min(kBins - 1, static_cast<int>((Centre(box, axis) - low) / extent * kBins));
      };
      const int cut = CheapestCut(range, bin_of);
      const auto middle = std::partition(
          begin, end, [&](int i) { return bin_of(boxes_[static_cast<std::size_t>(i)]) < cut; });
      if (middle != begin && middle != end) return static_cast<int>(middle - order_.begin());
    }
    return (range.begin + range.end) / 2;
  }

  // The number of bins that go to the lower side.
  template <typename BinOf>
  int CheapestCut(const Range& range, const BinOf& bin_of) const {
    std::array<Bounds, kBins> box;
    std::array<int, kBins> count{};
    for (int i = range.begin; i < range.end; ++i) {
      const auto bin = static_cast<std::size_t>(bin_of(BoxAt(i)));
      box[bin].Add(BoxAt(i));
      ++count[bin];
    }
    std::array<float, kBins> upper_cost{};
    Bounds upper;
    int above = 0;
    for (std::size_t bin = kBins - 1; bin > 0; --bin) {
      upper.Add(box[bin]);
      above += count[bin];
      upper_cost[bin] = above > 0 ? upper.HalfArea() * static_cast<float>(above) : 0.0F;
    }
    int best = kBins / 2;
    float best_cost = kNoHit;
    Bounds lower;
    int below = 0;
    for (std::size_t bin = 1; bin < kBins; ++bin) {
      lower.Add(box[bin - 1]);
      below += count[bin - 1];
      if (below == 0 || below == range.Size()) continue;
      const float cost = lower.HalfArea() * static_cast<float>(below) + upper_cost[bin];
      if (cost < best_cost) {
        best_cost = cost;
        best = static_cast<int>(bin);
      }
    }
    return best;
  }

  PrimitiveTree& tree_;
  std::vector<Bounds> boxes_;
  std::vector<int> order_;
};

PrimitiveTree::PrimitiveTree(std::vector<Primitive> primitives)
    : primitives_(std::move(primitives)) {
  Builder(this).Build();
}

const Primitive* PrimitiveTree::ClosestHit(const Ray& ray, float* range) const {
  if (nodes_.empty()) return nullptr;
  std::array<float, 3> inverse;
  std::array<std::size_t, 3> near_side;  // which face of a box the ray meets first
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const float d = ray.direction[static_cast<Eigen::Index>(axis)];
    inverse[axis] = 1.0F / (std::abs(d) > 1e-12F ? d : 1e-12F);
    near_side[axis] = inverse[axis] < 0.0F ? 1 : 0;
  }
  const Primitive* hit = nullptr;
  Stack stack;
  stack.Push({0, 0, 0.0F});
  while (!stack.Empty()) {
    const StackEntry entry = stack.Pop();
    if (entry.range >= *range) continue;
    if (entry.count == 0) {
      const Node& node = nodes_[static_cast<std::size_t>(entry.first)];
      Eigen::Array4f enter = Eigen::Array4f::Zero();
      Eigen::Array4f leave = Eigen::Array4f::Constant(*range);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const float o = ray.origin[static_cast<Eigen::Index>(axis)];
        enter = enter.max((node.box[near_side[axis]][axis] - o) * inverse[axis]);
        leave = leave.min((node.box[1 - near_side[axis]][axis] - o) * inverse[axis]);
      }
      // Rounding must not open a gap between a box and the flat primitive within.
      const Eigen::Array4f key = (enter <= leave * 1.000002F + 1e-5F).select(enter, kNoHit);
      stack.PushChildren(node, key, *range);
      continue;
    }
    for (std::int32_t i = entry.first; i < entry.first + entry.count; ++i) {
      const Primitive& primitive = primitives_[static_cast<std::size_t>(i)];
      const float r = Intersect(primitive, ray);
      if (r < *range) {
        *range = r;
        hit = &primitive;
      }
    }
  }
  return hit;
}

float PrimitiveTree::Distance(const Eigen::Vector3f& point, float bound) const {
  if (nodes_.empty()) return bound;
  float best = bound;
  Stack stack;
  stack.Push({0, 0, 0.0F});
  while (!stack.Empty()) {
    const StackEntry entry = stack.Pop();
    if (entry.range >= best) continue;
    if (entry.count == 0) {
      const Node& node = nodes_[static_cast<std::size_t>(entry.first)];
      Eigen::Array4f square = Eigen::Array4f::Zero();
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const float p = point[static_cast<Eigen::Index>(axis)];
        square += (node.box[0][axis] - p).max(p - node.box[1][axis]).max(0.0F).square();
      }
      stack.PushChildren(node, square.sqrt(), best);
      continue;
    }
    for (std::int32_t i = entry.first; i < entry.first + entry.count; ++i) {
      best = std::min(best, SurfaceDistance(primitives_[static_cast<std::size_t>(i)], point));
    }
  }
  return best;
}

}  // namespace lamina::synth
