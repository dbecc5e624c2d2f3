#include "io/points/kitti_scan.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

#include "core/base/error.h"
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
