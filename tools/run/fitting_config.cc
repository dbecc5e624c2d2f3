#include "tools/run/fitting_config.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <optional>

#include "core/base/angle.h"
#include "core/base/error.h"
#include "core/base/median.h"
#include "core/map/voxel_map.h"
#include "frontend/scan/horizontal_view.h"
#include "frontend/scan/scan_clusters.h"
#include "frontend/scan/scan_preparation.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// Runs of elevations with nothing between them, if most of what lies between lowest and highest is
// empty.
int CountRings(const std::vector<double>& elevations, double lowest, double highest) {
  constexpr double kBinDeg = 0.05;
  const auto bins = static_cast<std::size_t>((highest - lowest) / kBinDeg) + 1;
  if (bins < 8 || bins > 3600) return 0;
  std::vector<std::size_t> counts(bins, 0);
  for (const double e : elevations) {
    if (e < lowest || e > highest) continue;
    ++counts[std::min(bins - 1, static_cast<std::size_t>((e - lowest) / kBinDeg))];
  }
  // Fewer are strays.
  const std::size_t least = std::max<std::size_t>(3, elevations.size() / 20000);
  int rings = 0;
  std::size_t empty = 0;
  for (std::size_t i = 0; i < bins; ++i) {
    const bool filled = counts[i] >= least;
    empty += filled ? 0 : 1;
    if (filled && (i == 0 || counts[i - 1] < least)) ++rings;
  }
  return 2 * empty > bins && rings >= 4 ? rings : 0;
}

// As many as tell of ranges. The step is odd: organised clouds have 2^k rows, each a beam.
std::vector<ScanPoint> SomeOf(const std::vector<ScanPoint>& points) {
  constexpr std::size_t kEnough = 10000;
  const std::size_t step = (points.size() / kEnough) | 1U;
  std::vector<ScanPoint> some;
  for (std::size_t i = 0; i < points.size(); i += step) some.push_back(points[i]);
  return some;
}

// A few scans spread over the range, both ends among them.
std::vector<std::size_t> AFewOf(const FrameRange& range) {
  constexpr std::size_t kScans = 5;
  const std::size_t size = range.end - std::min(range.begin, range.end);
  std::vector<std::size_t> scans;
  for (std::size_t i = 0; i < kScans && size > 0; ++i) {
    const std::size_t scan = range.begin + i * (size - 1) / (kScans - 1);
    if (scans.empty() || scan != scans.back()) scans.push_back(scan);
  }
  return scans;
}

// Whether the next scan, as a rule, follows later than any sensor delivers it. Reads none.
bool AreFarApart(const ScanSource& source, const std::vector<std::size_t>& scans) {
  constexpr double kLeastApartS = 0.25;
  if (!source.recorded_stamps()) return false;
  std::vector<double> apart_s;
  for (const std::size_t scan : scans) {
    const std::optional<StampNs> after = source.StampAfter(scan);
    if (after) apart_s.push_back(SecondsBetween(source.Stamp(scan), *after));
  }
  return !apart_s.empty() && UpperMedian(&apart_s) > kLeastApartS;
}

// The share of a scan's points that have enough others in their voxel to make a plane of the
// defaults: of scans as sensors deliver them half and more.
double ShareInFullVoxels(const Scan& scan) {
  const VoxelMapOptions map;
  const std::vector<TimedPoint> points =
      PrepareScan(scan, ScanPreparationOptions(), ScanSourceOptions().frame_period_s).points;
  double full = 0.0;
  for (const TimedCluster& cluster : BuildScanClusters(points, map.LeafSize())) {
    if (cluster.points.count >= map.min_points) full += cluster.points.count;
  }
  return points.empty() ? 0.0 : full / static_cast<double>(points.size());
}

// What a few scans tell of a recording.
struct Glance {
  std::vector<SensorGuess> sensor;
  std::vector<std::size_t> points;  // of a scan
  std::vector<double> full;         // ShareInFullVoxels, where scans are far apart
};

Glance LookAtAFew(const ScanSource& source, const FrameRange& range) {
  const std::vector<std::size_t> scans = AFewOf(range);
  const bool far_apart = AreFarApart(source, scans);
  Glance glance;
  for (const std::size_t scan : scans) {
    try {
      const Scan read = source.Read(scan);
      const SensorGuess guess = GuessSensor(SomeOf(read.points));
      if (guess.farthest_m <= 0.0) continue;
      glance.sensor.push_back(guess);
      glance.points.push_back(read.points.size());
      if (far_apart) glance.full.push_back(ShareInFullVoxels(read));
    } catch (const InputError&) {
      // The run will say so.
    }
  }
  return glance;
}

bool IsNarrow(const SensorGuess& sensor) { return sensor.around_deg < 150.0 && sensor.rings == 0; }

// A view all around without rings, and as few points as such a sensor has in a tenth of a second:
// they lie apart, and no two scans repeat a ray. Scans that were thinned have lost their rings as
// well, and lie apart as much.
bool AreSpread(Glance glance) {
  constexpr std::size_t kFewPoints = 40000;
  const std::vector<SensorGuess>& guesses = glance.sensor;
  return !guesses.empty() && UpperMedian(&glance.points) < kFewPoints &&
         std::all_of(guesses.begin(), guesses.end(), [](const SensorGuess& sensor) {
           return sensor.rings == 0 && !IsNarrow(sensor);
         });
}

// Planes of a place are about as large as it is: of rooms and stairs, nine points of ten are within
// 9 m; of streets, halls, and beside a lorry, within 13 m or more.
constexpr double kSmallPlaceM = 10.0;

// Of the scans of a small place the one that sees least, if there are such. What is mapped well
// there is mapped well elsewhere, for more work, so one scan is enough, if it sees far to hardly
// any side: on a road lorries may stand or drive all about the sensor, and leave gaps. What sees
// far to many sides is no small place, though most points lie near by, as those of a wide view on
// the ground and on the vehicle itself: of rooms, mines and tunnels 0.35 at most, of motorways 0.43
// and more; and scans that see somewhat less are then of the same place.
const SensorGuess* SmallPlace(const std::vector<SensorGuess>& guesses) {
  constexpr double kHardlyAny = 0.1, kMany = 0.4;
  const SensorGuess* smallest = nullptr;
  int small = 0;
  bool closed = false, open = false;
  for (const SensorGuess& guess : guesses) {
    const bool sees_far = guess.far_share >= kMany;
    open = open || sees_far;
    if (sees_far || guess.mostly_m >= kSmallPlaceM) continue;
    ++small;
    closed = closed || guess.far_share < kHardlyAny;
    if (smallest == nullptr || guess.mostly_m < smallest->mostly_m) smallest = &guess;
  }
  return closed || (small > 1 && !open) ? smallest : nullptr;
}

// Scans that were thinned and picked: far apart, and as a rule too few points share a voxel to make
// a plane.
bool AreKeyframes(Glance glance) {
  constexpr double kMostInFullVoxels = 0.6;
  return !glance.full.empty() && UpperMedian(&glance.full) < kMostInFullVoxels;
}

}  // namespace

SensorGuess GuessSensor(const std::vector<ScanPoint>& points) {
  // Shares of points that may be strays; nearer ones may be the vehicle's own.
  constexpr double kOutliers = 0.005, kLeastRangeM = 1.0;
  SensorGuess guess;
  guess.points = points.size();
  std::vector<double> elevations, ranges;
  constexpr double kFarM = 15.0;
  HorizontalView view, far;
  for (const ScanPoint& p : points) {
    const double flat = std::hypot(p.x, p.y), range = std::hypot(flat, p.z);
    if (!std::isfinite(range) || range < kLeastRangeM) continue;
    ranges.push_back(range);
    elevations.push_back(Degrees(std::atan2(p.z, flat)));
    view.Add(p.x, p.y);
    if (flat > kFarM) far.Add(p.x, p.y);
  }
  if (ranges.empty()) return guess;
  guess.lowest_deg = Quantile(&elevations, kOutliers);
  guess.highest_deg = Quantile(&elevations, 1.0 - kOutliers);
  constexpr double kMost = 0.9;
  guess.mostly_m = Quantile(&ranges, kMost);
  guess.farthest_m = Quantile(&ranges, 1.0 - kOutliers);
  guess.rings = CountRings(elevations, guess.lowest_deg, guess.highest_deg);
  guess.around_deg = view.degrees();
  guess.far_share = far.share() / view.share();
  return guess;
}

FittingConfig FindFittingConfig(const ScanSource& source, const FrameRange& range) {
  const Glance glance = LookAtAFew(source, range);
  const std::vector<SensorGuess>& guesses = glance.sensor;
  if (!guesses.empty() && std::all_of(guesses.begin(), guesses.end(), IsNarrow)) {
    return {"livox_avia", "a narrow view without rings", true};
  }
  if (const SensorGuess* const small = SmallPlace(guesses)) {
    return {"handheld",
            fmt::format("a small place, nine points of ten within {:.1f} m", small->mostly_m),
            true};
  }
  if (AreKeyframes(glance)) {
    return {"keyframes", "thinned scans that are metres apart", true};
  }
  if (!source.spins() && AreSpread(glance)) {
    return {"livox_mid360", "few points all around, on no rings", true};
  }
  const fs::path folder = fs::weakly_canonical(fs::absolute(source.Name(0))).parent_path();
  const fs::path above = folder.parent_path();
  if (folder.filename() == "velodyne" && above.parent_path().filename() == "sequences") {
    return {"kitti_odometry", "a sequence of KITTI odometry", false};
  }
  if (folder.filename() == "data" && above.filename() == "velodyne_points") {
    return {"kitti_raw", "a KITTI raw drive", false};
  }
  return {};
}

}  // namespace lamina
