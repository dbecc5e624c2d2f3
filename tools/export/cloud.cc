#include "tools/export/cloud.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/map/voxel_key.h"
#include "tools/export/thinning.h"

namespace lamina {
namespace {

constexpr size_t kScansPerBatch = 8;

// A scan in the world frame.
struct WorldScan {
  std::vector<Eigen::Vector3d> points;
  std::vector<float> intensities;
  std::vector<double> stamps_s;
  double radius_m = 0.0;  // of the ball around the pose that holds all points
};

// Intensities of the points that PrepareScan keeps. It carries one number a point through its
// filter, the time; here that number is the intensity.
std::vector<float> KeptIntensities(const Scan& scan, ScanPreparationOptions options,
                                   size_t expected) {
  options.deskew = ScanPreparationOptions::Deskew::kTime;
  Scan tagged;
  tagged.points = scan.points;
  for (const ScanPoint& p : scan.points) {
    tagged.time_s.push_back(std::isfinite(p.intensity) ? p.intensity : 0.0F);
  }
  std::vector<float> intensities;
  for (const TimedPoint& p : PrepareScan(tagged, options, 1.0).points) {
    intensities.push_back(p.time_s);
  }
  // Points dropped for a broken time of their own would shift all that follow.
  if (intensities.size() != expected) intensities.assign(expected, 0.0F);
  return intensities;
}

WorldScan ReadWorldScan(const ScanSource& scans, const PosedScan& posed,
                        const ExportOptions& options) {
  const Scan scan = scans.Read(posed.scan);
  const double period_s = SweepPeriodOfScan(scans, posed.scan, options.frame_period_s);
  const PreparedScan prepared =
      PrepareScan(scan, options.preparation, period_s, scans.T_vehicle_lidar(posed.scan));
  const SweepDeskew deskew(posed.sweep);
  const Eigen::Matrix3d R = posed.T_world_lidar.R();
  WorldScan world;
  world.intensities = KeptIntensities(scan, options.preparation, prepared.points.size());
  world.points.reserve(prepared.points.size());
  world.stamps_s.reserve(prepared.points.size());
  const double stamp_s = kSecondsPerNs * static_cast<double>(scans.Stamp(posed.scan));
  double radius2 = 0.0;
  for (const TimedPoint& p : prepared.points) {
    const Eigen::Vector3d lidar = deskew(p);
    radius2 = std::max(radius2, lidar.squaredNorm());
    world.points.push_back(R * lidar + posed.T_world_lidar.t);
    world.stamps_s.push_back(stamp_s + static_cast<double>(p.time_s));
  }
  // A little more, for rounding on the way to the world.
  world.radius_m = std::sqrt(radius2) * (1.0 + 1e-9) + 1e-6;
  return world;
}

// One export under way.
class Exporter {
 public:
  Exporter(const ScanSource& scans, const std::vector<PosedScan>& posed,
           const ExportOptions& options, CloudWriter* writer, const std::atomic<bool>* stop)
      : scans_(scans),
        posed_(posed),
        options_(options),
        writer_(writer),
        stop_(stop),
        thinner_(static_cast<size_t>(options.budget_mb) << 20),
        radius_m_(posed.size(), 0.0) {}

  ExportResult Run() {
    while (!Stopped() && thinner_.BeginPass()) RunPass();
    result_.interrupted = Stopped();
    result_.points = thinner_.kept();
    result_.passes = thinner_.passes();
    return result_;
  }

 private:
  void RunPass() {
    const bool first = thinner_.passes() == 1;
    std::vector<size_t> todo;
    for (size_t i = 0; i < posed_.size(); ++i) {
      if (first || ReachesBox(i)) todo.push_back(i);
    }
    for (size_t begin = 0; begin < todo.size() && !Stopped(); begin += kScansPerBatch) {
      const size_t size = std::min(kScansPerBatch, todo.size() - begin);
      std::vector<WorldScan> batch(size);
      ParallelChunks(size, 1, [&](size_t k, size_t) {
        batch[k] = ReadWorldScan(scans_, posed_[todo[begin + k]], options_);
      });
      for (size_t k = 0; k < size; ++k) {
        radius_m_[todo[begin + k]] = batch[k].radius_m;
        Thin(batch[k], todo[begin + k], first);
      }
    }
  }

  bool Stopped() const { return stop_ != nullptr && stop_->load(); }

  // Known from the first pass, which reads every scan.
  bool ReachesBox(size_t i) const {
    return thinner_.box().MeetsBall(posed_[i].T_world_lidar.t, radius_m_[i], options_.resolution_m);
  }

  void Thin(const WorldScan& scan, size_t place, bool first_pass) {
    const double inverse_size = 1.0 / options_.resolution_m;
    std::vector<CloudPoint> kept;
    for (size_t i = 0; i < scan.points.size(); ++i) {
      const Eigen::Vector3d& p = scan.points[i];
      if (!IsVoxelKeyInRange(p, inverse_size)) {
        if (first_pass) ++result_.points_beyond_grid;
        continue;
      }
      if (!thinner_.Keep(VoxelKeyOf(p, inverse_size), {place, i})) continue;
      kept.push_back({p, scan.intensities[i], scan.stamps_s[i]});
    }
    writer_->Append(kept);
  }

  const ScanSource& scans_;
  const std::vector<PosedScan>& posed_;
  const ExportOptions& options_;
  CloudWriter* writer_;
  const std::atomic<bool>* stop_;
  PassThinner thinner_;
  std::vector<double> radius_m_;
  ExportResult result_;
};

}  // namespace

void ExportOptions::Visit(OptionVisitor& v) {
  v.Number("resolution_m", &resolution_m, 0.001, 1000.0);
  v.Integer("budget_mb", &budget_mb, 1, 1 << 20);
  v.Number("frame_period_s", &frame_period_s, 1e-6, 1e3);
  v.Group("preparation", &preparation);
}

ExportResult ExportCloud(const ScanSource& scans, const std::vector<PosedScan>& posed,
                         const ExportOptions& options, CloudWriter* writer,
                         const std::atomic<bool>* stop) {
  CheckOptions(options, "export");
  return Exporter(scans, posed, options, writer, stop).Run();
}

}  // namespace lamina
