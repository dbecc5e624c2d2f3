#include "io/points/kitti_scan.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

#include "core/base/error.h"
#include "core/base/median.h"
#include "core/base/thinning.h"
#include "io/file/text_input.h"

namespace lamina {
namespace {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
              ".bin files are little-endian and are read straight into memory");

Scan WithPoints(Scan scan, const std::string& path) {
  if (scan.points.empty()) throw InputError(fmt::format("{}: is empty: holds no points", path));
  return scan;
}

struct RingPoint {
  ScanPoint point;
  float ring = 0.0F;
};
static_assert(sizeof(RingPoint) == 20, "must match the layout of nuScenes .bin files");

// Whether every fifth number is that of a ring. In records of four it is now a coordinate and now
// an intensity.
bool HaveRings(const std::vector<RingPoint>& points) {
  constexpr float kMostRings = 256.0F;
  bool any = false;
  for (const RingPoint& p : points) {
    if (!(p.ring >= 0.0F && p.ring < kMostRings) || p.ring != std::floor(p.ring)) return false;
    any = any || p.ring > 0.0F;
  }
  return any;
}

// Median distance from a point to the next, if points are of so many numbers.
double MedianStep(const std::vector<ScanPoint>& numbers, std::size_t size) {
  const auto* const all = reinterpret_cast<const float*>(numbers.data());
  const std::size_t points = 4 * numbers.size() / size;
  const std::size_t stride = StrideToAtLeast(points, 1000);
  std::vector<double> steps;
  for (std::size_t i = 0; i + 1 < points; i += stride) {
    const float* const p = all + i * size;
    const float* const q = p + size;
    const double step =
        std::hypot(static_cast<double>(p[0] - q[0]), static_cast<double>(p[1] - q[1]),
                   static_cast<double>(p[2] - q[2]));
    if (std::isfinite(step)) steps.push_back(step);
  }
  return steps.empty() ? 0.0 : UpperMedian(&steps);
}

// A sensor's points lie beside one another in the order in which they were measured. If they do so
// by another size of points alone, it is theirs, and by four numbers a coordinate is now x and now
// something else. Returns 4 where nothing speaks against it.
std::size_t NumbersOfPoints(const std::vector<ScanPoint>& numbers) {
  // Not 8: of a sensor that fires two far beams in turn, every second point lies beside the next.
  constexpr std::size_t kEnough = 100, kMostNumbers = 7;
  constexpr double kClearly = 0.2;
  if (numbers.size() < kEnough) return 4;
  const double by_four = MedianStep(numbers, 4);
  for (std::size_t size = 5; size <= kMostNumbers; ++size) {
    if (4 * numbers.size() % size == 0 && MedianStep(numbers, size) < kClearly * by_four)
      return size;
  }
  return 4;
}

}  // namespace

bool IsWholeKittiBin(std::size_t bytes) {
  return bytes % sizeof(ScanPoint) == 0 || bytes % sizeof(RingPoint) == 0;
}

Scan ReadKittiBin(const std::string& path, PointTimeUnit /*unit*/, PointTimeField* /*times*/) {
  InputFile file(path);
  if (!IsWholeKittiBin(file.size())) {
    throw InputError(
        fmt::format("{}: has {} bytes, must be a multiple of 16 (x y z intensity, "
                    "float32), or of 20 (and the ring)",
                    path, file.size()));
  }
  constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 31;
  if (file.size() > kMostBytes)
    throw InputError(fmt::format("{}: has {} bytes, more than 2 GB", path, file.size()));
  std::vector<RingPoint> with_rings;
  if (file.size() % sizeof(RingPoint) == 0) {
    with_rings.resize(file.size() / sizeof(RingPoint));
    file.Read(with_rings.data(), file.size());
  }
  Scan scan;
  if (HaveRings(with_rings)) {
    for (const RingPoint& p : with_rings) scan.points.push_back(p.point);
    return scan;
  }
  if (file.size() % sizeof(ScanPoint) != 0) {
    throw InputError(fmt::format(
        "{}: has {} bytes, which are points of 20, but none with the number of its ring", path,
        file.size()));
  }
  scan.points.resize(file.size() / sizeof(ScanPoint));
  if (with_rings.empty()) {
    file.Read(scan.points.data(), file.size());
  } else {
    std::memcpy(static_cast<void*>(scan.points.data()), with_rings.data(), file.size());
  }
  if (const std::size_t numbers = NumbersOfPoints(scan.points); numbers != 4) {
    throw InputError(fmt::format(
        "{}: its points seem to be of {} numbers; read are those of 4 (x y z intensity) and of 5 "
        "(and the ring)",
        path, numbers));
  }
  return WithPoints(std::move(scan), path);
}

Scan ReadKittiText(const std::string& path, PointTimeUnit /*unit*/, PointTimeField* /*times*/) {
  const std::string text = ReadFile(path);
  LineReader lines(path, text);
  Scan scan;
  std::vector<double> numbers;
  while (lines.Next()) {
    lines.Numbers(&numbers);
    if (numbers.size() != 4) {
      lines.Fail(fmt::format("a point has 4 numbers (x y z intensity), found {}", numbers.size()));
    }
    const auto value = [&](std::size_t i) { return static_cast<float>(numbers[i]); };
    scan.points.push_back({value(0), value(1), value(2), value(3)});
  }
  return WithPoints(std::move(scan), path);
}

}  // namespace lamina
