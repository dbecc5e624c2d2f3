#include "tools/results/verdict/process_report.h"

#include <fmt/format.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>

#include "io/map/map_io.h"
#include "io/map/trajectory_io.h"

namespace lamina {

nlohmann::json NumberOrNull(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json();
}

FrameTable::FrameTable(const std::string& path, int max_iterations)
    : writer_(path), verdict_(max_iterations) {
  writer_.Write(
      "scan,stamp_s,status,keyframe,points,clusters,matched,iterations,inlier_share,residual_m,"
      "searched,unobservable_directions,worst_sigma_m,cov_rx,cov_ry,cov_rz,cov_x,cov_y,cov_z,"
      "piece,read_ms,prepare_ms,cluster_ms,odometry_ms,map_ms,solve_ms\n");
}

void FrameTable::Append(const ScanRecord& s) {
  std::string line = fmt::format("{},", s.scan);
  AppendSeconds(s.stamp_ns, &line);
  line += fmt::format(",{},{},{},{},{},{},{:.4f},{:.5f},{},{},{:.5f}", s.status, s.keyframe ? 1 : 0,
                      s.points, s.clusters, s.matched, s.iterations, s.inlier_share, s.residual_m,
                      s.searched ? 1 : 0, s.unobservable_directions, s.worst_sigma_m);
  for (int i = 0; i < 6; ++i) line += fmt::format(",{:.3e}", s.covariance(i, i));
  line += fmt::format(",{},{:.2f},{:.2f},{:.2f},{:.2f},{:.2f},{:.2f}\n", s.piece, s.read_ms,
                      s.prepare_ms, s.cluster_ms, s.odometry_ms, s.map_ms, s.solve_ms);
  writer_.Write(line);
  CountPiece(s);
  verdict_.Add(s);
}

void FrameTable::CountPiece(const ScanRecord& s) {
  const auto [at, fresh] = pieces_.try_emplace(s.piece);
  PieceFigures& piece = at->second;
  if (fresh) {
    piece.recording = s.sequence;
    piece.first_scan = s.scan;
  }
  piece.last_scan = s.scan;
  if (s.skipped) return;
  ++piece.frames;
  piece.lost += s.status == "lost" ? 1 : 0;
  piece.recorded_stamps = piece.recorded_stamps && s.recorded_stamp;
}

void FrameTable::Join(const std::map<std::int64_t, std::int64_t>& joins) {
  joins_ = joins;
  for (const auto& [piece, frame] : joins) verdict_.Join(piece);
}

std::int64_t FrameTable::FrameOf(std::int64_t piece) const {
  const auto join = joins_.find(piece);
  return join == joins_.end() ? piece : join->second;
}

std::map<std::int64_t, PieceFigures> FrameTable::FramesOfPieces() const {
  std::map<std::int64_t, PieceFigures> frames;
  for (const auto& [number, piece] : pieces_) {
    const auto [at, fresh] = frames.try_emplace(FrameOf(number), piece);
    if (fresh) continue;
    at->second.last_scan = piece.last_scan;
    at->second.frames += piece.frames;
    at->second.lost += piece.lost;
  }
  return frames;
}

nlohmann::json FrameTable::PiecesToJson() const {
  nlohmann::json json = ToJson(pieces_);
  for (nlohmann::json& piece : json) {
    const auto number = piece["piece"].get<std::int64_t>();
    if (!joins_.empty()) piece["frame"] = FrameOf(number);
    for (const auto& [other, figures] : pieces_) {
      if (other != number && FrameOf(other) == FrameOf(number))
        piece["connected_to"].push_back(other);
    }
  }
  return json;
}

double ProcessCpuSeconds() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

std::size_t PeakRssBytes() {
  // Not getrusage: what it tells begins with the peak of the program that started this one.
  std::ifstream status("/proc/self/status");
  std::size_t kilobytes = 0;
  for (std::string word; status >> word;) {
    if (word == "VmHWM:" && status >> kilobytes) return kilobytes * 1024;
  }
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

std::string NewPieceMessage(const MappedScan& report) {
  return fmt::format(
      "scan {} begins piece {} of the map: nothing connects it to what was mapped before",
      report.index, report.piece);
}

void PrintOutputs(const std::string& folder) {
  fmt::print(
      "trajectory  {0}/trajectory_tum.txt, {0}/trajectory_kitti.txt\n"
      "map         {0}/map_surfels.ply\n"
      "figures     {0}/summary.json, {0}/frames.csv\n",
      folder);
}

std::string MapFileName(std::int64_t piece) {
  return piece == 0 ? "map_surfels.ply" : fmt::format("map_surfels_piece{}.ply", piece);
}

namespace {

// The last number in a text; -1 if there is none.
std::int64_t LastNumber(const std::string& text) {
  constexpr const char* kDigits = "0123456789";
  const std::size_t end = text.find_last_of(kDigits);
  if (end == std::string::npos) return -1;
  const std::size_t before = text.find_last_not_of(kDigits, end);
  const std::size_t begin = before == std::string::npos ? 0 : before + 1;
  std::int64_t number = -1;
  const auto read = std::from_chars(text.data() + begin, text.data() + end + 1, number);
  return read.ec == std::errc() ? number : -1;
}

}  // namespace

std::optional<std::int64_t> PieceOfFile(const std::string& name,
                                        std::string (*name_of)(std::int64_t piece)) {
  const std::int64_t piece = LastNumber(name);
  return piece >= 0 && name == name_of(piece) ? std::optional(piece) : std::nullopt;
}

void RemovePieceFiles(const std::string& folder, std::string (*name_of)(std::int64_t piece)) {
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(folder, ignored)) {
    if (!PieceOfFile(entry.path().filename().string(), name_of)) continue;
    std::filesystem::remove(entry.path(), ignored);
  }
}

int LeastSurfelFrames(int configured, const MappingCounts& counts) {
  if (counts.keyframes == 0) return configured;
  return static_cast<int>(std::min(counts.keyframes, static_cast<std::size_t>(configured)));
}

std::size_t WriteMap(const std::string& folder, const VoxelMap& map, int min_frames) {
  const auto path = [&](std::int64_t piece) {
    return (std::filesystem::path(folder) / MapFileName(piece)).string();
  };
  RemovePieceFiles(folder, MapFileName);
  // Files are open at once, so many pieces at a time.
  constexpr std::int64_t kAtOnce = 64;
  std::size_t surfels = 0;
  std::int64_t last = 0;
  for (std::int64_t first = 0; first <= last; first += kAtOnce) {
    std::map<std::int64_t, SurfelWriter> writers;
    if (first == 0) writers.try_emplace(0, path(0));  // there in any case
    map.ForEachSurface(min_frames, [&](const Surfel& surfel) {
      last = std::max(last, surfel.piece);
      if (surfel.piece < first || surfel.piece >= first + kAtOnce) return;
      writers.try_emplace(surfel.piece, path(surfel.piece)).first->second.Append(surfel);
    });
    for (auto& [piece, writer] : writers) {
      writer.Commit();
      surfels += writer.size();
    }
  }
  return surfels;
}

std::string SummaryText(const nlohmann::json& summary) {
  return summary.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

nlohmann::json ToJson(const std::map<std::int64_t, PieceFigures>& pieces) {
  nlohmann::json json = nlohmann::json::array();
  for (const auto& [number, piece] : pieces) {
    json.push_back({{"piece", number},
                    {"recording", piece.recording},
                    {"first_scan", piece.first_scan},
                    {"last_scan", piece.last_scan},
                    {"frames", piece.frames},
                    {"lost_frames", piece.lost},
                    {"recorded_stamps", piece.recorded_stamps},
                    {"connected_to", nlohmann::json::array()}});
  }
  return json;
}

nlohmann::json Summarise(const MappingCounts& counts, const VoxelMap& map,
                         const RunFigures& figures) {
  const auto frames = static_cast<double>(counts.frames);
  nlohmann::json skipped = nlohmann::json::object();
  std::size_t skipped_total = 0;
  for (const auto& [reason, count] : counts.skipped) {
    skipped[ToString(reason)] = count;
    skipped_total += count;
  }
  return {
      {"frames", counts.frames},
      {"keyframes", counts.keyframes},
      {"skipped_scans", skipped_total},
      {"skipped_by_reason", skipped},
      {"lost_frames", counts.lost},
      {"restarts", counts.restarts},
      {"degenerate_frames", counts.degenerate},
      {"searched_frames", counts.searched},
      {"interrupted", figures.interrupted},
      {"opening_s", figures.opening_s},
      {"wall_s", figures.wall_s},
      {"cpu_s", figures.cpu_s},
      {"cpu_ms_per_frame", NumberOrNull(1e3 * figures.cpu_s / frames)},
      {"frames_per_s", NumberOrNull(frames / figures.wall_s)},
      {"peak_rss_bytes", PeakRssBytes()},
      {"map_voxels", map.roots()},
      {"map_nodes", map.nodes()},
      {"map_leaves", map.leaves()},
      {"map_bytes", map.bytes()},
      {"map_peak_bytes", figures.map_peak_bytes},
      {"map_over_budget", figures.map_over_budget},
      {"map_surfels", figures.map_surfels},
      {"ba_solves", counts.solves},
      {"ba_failed_solves", counts.failed_solves},
      {"ba_discarded_solves", counts.discarded_solves},
  };
}

}  // namespace lamina
