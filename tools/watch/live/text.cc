#include "tools/watch/live/text.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "core/base/printable_text.h"

namespace lamina {
namespace {

nlohmann::json CheckpointJson(const LiveReport& report) {
  if (!report.status.checkpoint) return nullptr;
  const LiveStatus::Checkpoint& c = *report.status.checkpoint;
  return {{"frame", c.frame},
          {"age_s", report.checkpoint_age_s},
          {"bytes", c.bytes},
          {"write_ms", c.write_ms}};
}

// By odometry, which never jumps; or, by T_map_world, in the map that loops have corrected.
nlohmann::json PoseJson(std::optional<LivePose> pose, const SE3& T_map_world = SE3()) {
  if (!pose) return nullptr;
  pose->T_world_lidar = T_map_world * pose->T_world_lidar;
  const Eigen::Vector3d& t = pose->T_world_lidar.t;
  const Eigen::Quaterniond& q = pose->T_world_lidar.q;
  return {{"index", pose->index},
          {"piece", pose->piece},
          // Nanoseconds of an epoch do not fit into the numbers of JavaScript.
          {"stamp_ns", std::to_string(pose->stamp_ns)},
          {"position_m", {t.x(), t.y(), t.z()}},
          {"quaternion_xyzw", {q.x(), q.y(), q.z(), q.w()}}};
}

void AddMetric(std::string* text, const char* name, const char* type, const char* help,
               double value) {
  *text += fmt::format("# HELP {0} {1}\n# TYPE {0} {2}\n{0} {3}\n", name, help, type, value);
}

void AddCounters(std::string* text, const LiveStatus& s) {
  const auto add = [&](const char* name, const char* help, std::uint64_t value) {
    AddMetric(text, name, "counter", help, static_cast<double>(value));
  };
  add("lamina_frames_total", "Scans mapped.", s.frames);
  add("lamina_keyframes_total", "Frames that joined the map.", s.keyframes);
  add("lamina_lost_frames_total", "Frames that did not match the map.", s.lost);
  add("lamina_degenerate_frames_total", "Frames with a direction that nothing held.", s.degenerate);
  add("lamina_pieces_total", "Pieces of the map, which nothing connects.", s.pieces);
  add("lamina_skipped_scans_total", "Scans that were read but not usable.", s.skipped);
  add("lamina_rejected_files_total", "Files that were set aside with a reason.", s.rejected);
  add("lamina_late_files_total", "Files that came after their turn.", s.late);
  add("lamina_solves_total", "Bundle adjustments.", s.solves);
  add("lamina_failed_solves_total", "Bundle adjustments that were not used.", s.failed_solves);
}

void AddGauges(std::string* text, const LiveReport& r) {
  const auto add = [&](const char* name, const char* help, double value) {
    AddMetric(text, name, "gauge", help, value);
  };
  const auto bytes = [](std::size_t value) { return static_cast<double>(value); };
  add("lamina_uptime_seconds", "Since the program started.", r.uptime_s);
  add("lamina_frame_rate_hertz", "Frames a second, over the last ten seconds.", r.rate_hz);
  add("lamina_lag_seconds", "From the newest frame's file being complete to its durable pose.",
      r.lag_s);
  add("lamina_latency_median_seconds", "Median lag of the newest 600 frames.",
      1e-3 * r.latency_median_ms);
  add("lamina_latency_p99_seconds", "99th percentile of the lag of the newest 600 frames.",
      1e-3 * r.latency_p99_ms);
  add("lamina_queue_files", "Complete files that wait in the inbox.", bytes(r.status.queue));
  add("lamina_map_bytes", "Memory of the map.", bytes(r.status.map_bytes));
  add("lamina_map_budget_bytes", "Memory that the map may take.", bytes(r.status.map_budget_bytes));
  add("lamina_map_surfels", "Planes in the map.", bytes(r.status.map_surfels));
  add("lamina_map_tiles", "Tiles of the map on disk.", bytes(r.status.tiles_on_disk));
  add("lamina_resident_memory_bytes", "Resident set of the process.", bytes(r.rss_bytes));
  add("lamina_degenerate_directions", "Directions of the newest frame that nothing holds.",
      static_cast<double>(r.status.degenerate_directions));
  add("lamina_verdict", "On the poses so far: 0 good, 1 doubtful, 2 probably wrong.",
      static_cast<double>(r.status.verdict.grade));
  add("lamina_failed", "1 while the stream stands still because of an error.",
      r.status.failure.empty() ? 0.0 : 1.0);
  if (!r.status.checkpoint) return;
  add("lamina_checkpoint_age_seconds", "Since the last checkpoint.", r.checkpoint_age_s);
  add("lamina_checkpoint_bytes", "Size of the last checkpoint.", bytes(r.status.checkpoint->bytes));
  add("lamina_checkpoint_write_seconds", "Time that the last checkpoint took.",
      1e-3 * r.status.checkpoint->write_ms);
}

}  // namespace

std::string StatusJson(const LiveReport& r) {
  const LiveStatus& s = r.status;
  return nlohmann::json({{"state", ToString(s.state)},
                         {"run_id", r.run_id},
                         {"uptime_s", r.uptime_s},
                         {"frames", s.frames},
                         {"keyframes", s.keyframes},
                         {"lost", s.lost},
                         {"degenerate", s.degenerate},
                         {"pieces", s.pieces},
                         {"skipped", s.skipped},
                         {"rejected", s.rejected},
                         {"late", s.late},
                         {"rate_hz", r.rate_hz},
                         {"lag_s", r.lag_s},
                         {"latency_median_ms", r.latency_median_ms},
                         {"latency_p99_ms", r.latency_p99_ms},
                         {"queue", s.queue},
                         {"map_bytes", s.map_bytes},
                         {"map_budget_bytes", s.map_budget_bytes},
                         {"map_surfels", s.map_surfels},
                         {"tiles_on_disk", s.tiles_on_disk},
                         {"rss_bytes", r.rss_bytes},
                         {"solves", s.solves},
                         {"failed_solves", s.failed_solves},
                         {"checkpoint", CheckpointJson(r)},
                         {"last_pose", PoseJson(r.last)},
                         {"last_pose_in_map", PoseJson(r.last, s.T_map_world)},
                         {"verdict", ToJson(s.verdict)},
                         {"degenerate_now", s.degenerate_directions > 0},
                         {"degenerate_directions", s.degenerate_directions},
                         {"last_error", Printable(s.last_error)},
                         {"failure", Printable(s.failure)}})
      .dump();
}

std::string TimingsJson(const TimingPage& page) {
  nlohmann::json json = {{"first", page.first}};
  const auto add = [&](const char* name, float StageTimes::*member) {
    nlohmann::json& list = json[name] = nlohmann::json::array();
    // A hundredth of a millisecond is more than a chart shows.
    for (const StageTimes& t : page.times) {
      list.push_back(std::round(100.0 * static_cast<double>(t.*member)) / 100.0);
    }
  };
  add("lag_ms", &StageTimes::lag_ms);
  add("read_ms", &StageTimes::read_ms);
  add("prepare_ms", &StageTimes::prepare_ms);
  add("cluster_ms", &StageTimes::cluster_ms);
  add("odometry_ms", &StageTimes::odometry_ms);
  add("map_ms", &StageTimes::map_ms);
  add("solve_ms", &StageTimes::solve_ms);
  add("durable_ms", &StageTimes::durable_ms);
  return json.dump();
}

std::string PrometheusText(const LiveReport& report) {
  std::string text;
  AddCounters(&text, report.status);
  AddGauges(&text, report);
  return text;
}

}  // namespace lamina
