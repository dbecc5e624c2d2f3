#include "io/points/kitti_scan.h"

#include <fmt/format.h>

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

}  // namespace

Scan ReadKittiBin(const std::string& path, PointTimeUnit /*unit*/, PointTimeField* /*times*/) {
  InputFile file(path);
  if (file.size() % sizeof(ScanPoint) != 0) {
    throw InputError(
        fmt::format("{}: has {} bytes, must be a multiple of 16 (x y z intensity, "
                    "float32)",
                    path, file.size()));
  }
  Scan scan;
  scan.points.resize(file.size() / sizeof(ScanPoint));
  file.Read(scan.points.data(), file.size());
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
