#include "tools/run_report.h"

#include <fmt/format.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include <cmath>
#include <fstream>

#include "io/map_io.h"

namespace lamina {
namespace {

nlohmann::json NumberOrNull(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json();
}

}  // namespace

FrameTable::FrameTable(const std::string& path) : writer_(path) {
  writer_.Write(
      "scan,stamp_s,status,keyframe,points,clusters,matched,iterations,inlier_share,residual_m,"
      "searched,unobservable_directions,worst_sigma_m,cov_rx,cov_ry,cov_rz,cov_x,cov_y,cov_z,"
      "read_ms,prepare_ms,cluster_ms,odometry_ms,map_ms,solve_ms\n");
}

void FrameTable::Append(const SessionScan& s) {
  std::string line =
      fmt::format("{},{}.{:09},{},{},{},{},{},{},{:.4f},{:.5f},{},{},{:.5f}", s.scan,
                  s.stamp_ns / 1000000000, s.stamp_ns % 1000000000, s.status, s.keyframe ? 1 : 0,
                  s.points, s.clusters, s.matched, s.iterations, s.inlier_share, s.residual_m,
                  s.searched ? 1 : 0, s.unobservable_directions, s.worst_sigma_m);
  for (int i = 0; i < 6; ++i) line += fmt::format(",{:.3e}", s.covariance(i, i));
  line += fmt::format(",{:.2f},{:.2f},{:.2f},{:.2f},{:.2f},{:.2f}\n", s.read_ms, s.prepare_ms,
                      s.cluster_ms, s.odometry_ms, s.map_ms, s.solve_ms);
  writer_.Write(line);
}

double ProcessCpuSeconds() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

std::size_t PeakRssBytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<std::size_t>(usage.ru_maxrss) * 1024;
}

std::size_t ResidentBytes() {
  std::ifstream statm("/proc/self/statm");
  std::size_t pages = 0, resident_pages = 0;
  if (!(statm >> pages >> resident_pages)) return 0;
  return resident_pages * static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
}

void PrintOutputs(const std::string& folder) {
  fmt::print(
      "trajectory  {0}/trajectory_tum.txt, {0}/trajectory_kitti.txt\n"
      "map         {0}/map_surfels.ply\n"
      "figures     {0}/summary.json, {0}/frames.csv\n",
      folder);
}

std::size_t WriteMap(const std::string& path, const VoxelMap& map, int min_frames) {
  SurfelWriter writer(path);
  map.ForEachSurface(min_frames, [&](const Surfel& surfel) { writer.Append(surfel); });
  writer.Commit();
  return writer.size();
}

nlohmann::json Summarise(const MappingCounts& counts, const VoxelMap& map,
                         const RunFigures& figures, const TrajectoryErrors* errors) {
  const auto frames = static_cast<double>(counts.frames);
  nlohmann::json skipped = nlohmann::json::object();
  std::size_t skipped_total = 0;
  for (const auto& [reason, count] : counts.skipped) {
    skipped[ToString(reason)] = count;
    skipped_total += count;
  }
  nlohmann::json json = {
      {"frames", counts.frames},
      {"keyframes", counts.keyframes},
      {"skipped_scans", skipped_total},
      {"skipped_by_reason", skipped},
      {"lost_frames", counts.lost},
      {"restarts", counts.restarts},
      {"degenerate_frames", counts.degenerate},
      {"searched_frames", counts.searched},
      {"interrupted", figures.interrupted},
      {"wall_s", figures.wall_s},
      {"cpu_s", figures.cpu_s},
      {"cpu_ms_per_frame", NumberOrNull(1e3 * figures.cpu_s / frames)},
      {"frames_per_s", NumberOrNull(frames / figures.wall_s)},
      {"peak_rss_bytes", PeakRssBytes()},
      {"map_voxels", map.roots()},
      {"map_nodes", map.nodes()},
      {"map_bytes", map.bytes()},
      {"map_peak_bytes", figures.map_peak_bytes},
      {"map_over_budget", figures.map_over_budget},
      {"map_surfels", figures.map_surfels},
      {"ba_solves", counts.solves},
      {"ba_failed_solves", counts.failed_solves},
      {"ba_discarded_solves", counts.discarded_solves},
  };
  if (errors != nullptr) {
    json["ape_rmse_m"] = NumberOrNull(errors->ape_rmse_m);
    json["rpe_rmse_m"] = NumberOrNull(errors->rpe_rmse_m);
    json["kitti_trel_percent"] = NumberOrNull(errors->kitti_trel_percent);
    json["kitti_rrel_deg_per_m"] = NumberOrNull(errors->kitti_rrel_deg_per_m);
  }
  return json;
}

}  // namespace lamina
