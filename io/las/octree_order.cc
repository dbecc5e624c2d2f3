#include "io/las/octree_order.h"

#include <algorithm>
#include <cstring>
#include <numeric>
#include <queue>
#include <string>
#include <vector>

namespace lamina {
namespace {

constexpr std::size_t kRunRecords = 1 << 20, kMergeBytes = 32 << 20;

struct Order {
  std::array<std::int32_t, 3> least;
  std::size_t record_bytes;

  bool operator()(const char* a, const char* b) const {
    const OctreePlace pa = OctreePlaceOf(a, least), pb = OctreePlaceOf(b, least);
    std::size_t axis = 0;
    std::uint32_t most = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t differs = pa[i] ^ pb[i];
      // Whether its highest bit is above that of the most so far.
      if (most < differs && most < (most ^ differs)) {
        most = differs;
        axis = i;
      }
    }
    if (most == 0) return std::memcmp(a, b, record_bytes) < 0;
    return pa[axis] < pb[axis];
  }
};

// A part of the spool that is in order, read some at a time.
class Run {
 public:
  Run(const SpoolFile& spool, std::uint64_t begin, std::uint64_t end, std::size_t record_bytes,
      std::size_t piece_bytes)
      : spool_(&spool),
        at_(begin),
        end_(end),
        record_bytes_(record_bytes),
        piece_bytes_(piece_bytes) {
    Fill();
  }
  bool done() const { return in_piece_ >= piece_.size(); }
  const char* record() const { return piece_.data() + in_piece_; }
  void Next() {
    in_piece_ += record_bytes_;
    if (done()) Fill();
  }

 private:
  void Fill() {
    const auto bytes = static_cast<std::size_t>(std::min<std::uint64_t>(piece_bytes_, end_ - at_));
    piece_ = spool_->Read(at_, bytes);
    at_ += bytes;
    in_piece_ = 0;
  }

  const SpoolFile* spool_;
  std::uint64_t at_, end_;
  std::size_t record_bytes_, piece_bytes_, in_piece_ = 0;
  std::string piece_;
};

void SortRun(SpoolFile* spool, std::uint64_t begin, std::size_t bytes, const Order& order) {
  const std::string records = spool->Read(begin, bytes);
  std::vector<std::uint32_t> places(bytes / order.record_bytes);
  std::iota(places.begin(), places.end(), 0U);
  std::sort(places.begin(), places.end(), [&](std::uint32_t a, std::uint32_t b) {
    return order(records.data() + a * order.record_bytes, records.data() + b * order.record_bytes);
  });
  // Some at a time: a second copy of all is not needed.
  std::string sorted;
  for (const std::uint32_t place : places) {
    sorted.append(records, place * order.record_bytes, order.record_bytes);
    if (sorted.size() < std::size_t{1} << 20) continue;
    spool->Overwrite(begin, sorted);
    begin += sorted.size();
    sorted.clear();
  }
  spool->Overwrite(begin, sorted);
}

}  // namespace

OctreePlace OctreePlaceOf(const char* record, const std::array<std::int32_t, 3>& least) {
  std::array<std::int32_t, 3> p;
  std::memcpy(p.data(), record, sizeof(p));
  OctreePlace place;
  for (std::size_t i = 0; i < 3; ++i) {
    place[i] = static_cast<std::uint32_t>(p[i]) - static_cast<std::uint32_t>(least[i]);
  }
  return place;
}

int DifferingBits(const OctreePlace& a, const OctreePlace& b) {
  std::uint32_t differs = (a[0] ^ b[0]) | (a[1] ^ b[1]) | (a[2] ^ b[2]);
  int bits = 0;
  for (; differs != 0; differs >>= 1) ++bits;
  return bits;
}

void VisitInOctreeOrder(SpoolFile* spool, std::size_t record_bytes,
                        const std::array<std::int32_t, 3>& least,
                        const std::function<void(std::string_view record)>& visit) {
  const Order order{least, record_bytes};
  const std::size_t run_bytes = kRunRecords * record_bytes;
  for (std::uint64_t begin = 0; begin < spool->size(); begin += run_bytes) {
    const std::uint64_t bytes = std::min<std::uint64_t>(run_bytes, spool->size() - begin);
    SortRun(spool, begin, static_cast<std::size_t>(bytes), order);
  }
  const auto run_count = static_cast<std::size_t>((spool->size() + run_bytes - 1) / run_bytes);
  const std::size_t piece_records =
      std::max<std::size_t>(kMergeBytes / record_bytes / std::max<std::size_t>(run_count, 1), 64);
  std::vector<Run> runs;
  for (std::uint64_t begin = 0; begin < spool->size(); begin += run_bytes) {
    runs.emplace_back(*spool, begin, std::min<std::uint64_t>(begin + run_bytes, spool->size()),
                      record_bytes, std::min(piece_records, kRunRecords) * record_bytes);
  }
  // Equal records are the same in any order.
  const auto later = [&](std::size_t a, std::size_t b) {
    return order(runs[b].record(), runs[a].record());
  };
  std::priority_queue<std::size_t, std::vector<std::size_t>, decltype(later)> next(later);
  for (std::size_t i = 0; i < runs.size(); ++i) next.push(i);
  while (!next.empty()) {
    const std::size_t i = next.top();
    next.pop();
    visit({runs[i].record(), record_bytes});
    runs[i].Next();
    if (!runs[i].done()) next.push(i);
  }
}

}  // namespace lamina
