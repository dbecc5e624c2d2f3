#include "io/points/scan_file.h"

#include <fmt/format.h>

#include <filesystem>

#include "core/base/error.h"
#include "io/file/text_input.h"
#include "io/points/ethz_csv.h"
#include "io/points/las_scan.h"
#include "io/points/point_cloud_files.h"
#include "io/points/scan_names.h"

namespace lamina {
namespace {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
              ".bin files are little-endian and are read straight into memory");

Scan ReadKittiBin(const std::string& path) {
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
  return scan;
}

Scan ReadKittiText(const std::string& path) {
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
  return scan;
}

}  // namespace

bool IsScanFile(const std::string& path) {
  const std::string ending = std::filesystem::path(path).extension().string();
  return ending == ".csv" ||
         KindOfName(std::filesystem::path(path).filename().string()) != ScanName::kNone;
}

Scan ReadScanFile(const std::string& path, PointTimeUnit unit, PointTimeField* times) {
  if (times != nullptr) *times = {};
  const std::string ending = std::filesystem::path(path).extension().string();
  if (ending == ".pcd") return ReadPcd(path, unit, times);
  if (ending == ".ply") return ReadPly(path, unit, times);
  if (ending == ".las" || ending == ".laz") return ReadLas(path, times);
  if (ending == ".csv") return ReadHokuyoCsv(path);
  if (ending != ".bin" && ending != ".txt") {
    throw InputError(fmt::format("{}: a point file ends in {}", path, kScanEndings));
  }
  Scan scan = ending == ".bin" ? ReadKittiBin(path) : ReadKittiText(path);
  if (scan.points.empty()) throw InputError(fmt::format("{}: is empty: holds no points", path));
  return scan;
}

}  // namespace lamina
