#include "tools/benchmark/floor.h"

#include <time.h>

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/geometry/scan_source.h"
#include "core/map/voxel_key.h"
#include "io/file/text_input.h"

namespace lamina {
namespace {

double ThreadCpuMs() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

// The clusters of one scan after another; slots of an earlier scan count as empty.
class ClusterTable {
 public:
  void Clear() {
    ++scan_;
    size_ = 0;
  }

  void Add(const Eigen::Vector3d& p, VoxelKey key) {
    Slot& slot = SlotOf(key);
    slot.count += 1.0;
    slot.sum += p;
    slot.products[0] += p.x() * p.x();
    slot.products[1] += p.x() * p.y();
    slot.products[2] += p.x() * p.z();
    slot.products[3] += p.y() * p.y();
    slot.products[4] += p.y() * p.z();
    slot.products[5] += p.z() * p.z();
  }

  std::size_t size() const { return size_; }

 private:
  struct Slot {
    VoxelKey key = 0;
    std::uint64_t scan = 0;
    double count = 0.0;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    double products[6] = {};
  };

  Slot& SlotOf(VoxelKey key) {
    if (2 * (size_ + 1) > slots_.size()) Grow();
    for (std::size_t i = HashVoxelKey(key) & (slots_.size() - 1);;
         i = (i + 1) & (slots_.size() - 1)) {
      Slot& slot = slots_[i];
      if (slot.scan != scan_) {
        slot = Slot();
        slot.key = key;
        slot.scan = scan_;
        ++size_;
        return slot;
      }
      if (slot.key == key) return slot;
    }
  }

  void Grow() {
    std::vector<Slot> before(2 * slots_.size());
    before.swap(slots_);
    size_ = 0;
    for (const Slot& slot : before) {
      if (slot.scan == scan_) SlotOf(slot.key) = slot;
    }
  }

  std::vector<Slot> slots_ = std::vector<Slot>(std::size_t{1} << 15);
  std::size_t size_ = 0;
  std::uint64_t scan_ = 0;
};

bool EndsWith(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

void ReadPoints(const ScanSource& source, std::size_t i, std::vector<ScanPoint>* points) {
  if (!EndsWith(source.Name(i), ".bin")) {
    *points = source.Read(i).points;
    return;
  }
  InputFile file(source.Name(i));
  points->resize(file.size() / sizeof(ScanPoint));
  file.Read(points->data(), points->size() * sizeof(ScanPoint));
}

}  // namespace

Floor MeasureFloor(const ScanSource& source, std::size_t frames, double leaf_size_m) {
  const double inverse_size = 1.0 / leaf_size_m;
  ClusterTable table;
  std::vector<ScanPoint> points;
  Floor floor;
  const double start = ThreadCpuMs();
  for (std::size_t i = 0; i < frames; ++i) {
    ReadPoints(source, i, &points);
    table.Clear();
    for (const ScanPoint& point : points) {
      const Eigen::Vector3d p(point.x, point.y, point.z);
      if (IsVoxelKeyInRange(p, inverse_size)) table.Add(p, VoxelKeyOf(p, inverse_size));
    }
    floor.points += static_cast<double>(points.size());
    floor.clusters += static_cast<double>(table.size());
  }
  const double n = static_cast<double>(frames);
  floor.cpu_ms = (ThreadCpuMs() - start) / n;
  floor.points /= n;
  floor.clusters /= n;
  return floor;
}

}  // namespace lamina
