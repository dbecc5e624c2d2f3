#include "tools/eval/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace lamina {
namespace {

// Right-aligned, "-" for what does not exist.
std::string Cell(double value, int width, int decimals) {
  return std::isnan(value) ? fmt::format("{:>{}}", "-", width)
                           : fmt::format("{:>{}.{}f}", value, width, decimals);
}

std::string SegmentTable(const std::vector<SegmentError>& segments) {
  std::string text;
  for (const SegmentError& s : segments) {
    if (s.segments == 0) {
      text += fmt::format("  {:>5.0f} m  no segment: the path is too short\n", s.length_m);
      continue;
    }
    text += fmt::format("  {:>5.0f} m  {} %  {} deg/m  {:>6} segments\n", s.length_m,
                        Cell(s.translation_percent, 8, 4), Cell(s.rotation_deg_per_m, 9, 5),
                        s.segments);
  }
  return text;
}

nlohmann::json SegmentsToJson(const std::vector<SegmentError>& segments) {
  nlohmann::json list = nlohmann::json::array();
  for (const SegmentError& s : segments) {
    list.push_back({{"length_m", s.length_m},
                    {"translation_percent", s.translation_percent},
                    {"rotation_deg_per_m", s.rotation_deg_per_m},
                    {"segments", s.segments}});
  }
  return list;
}

}  // namespace

std::string DescribeAlignment(Alignment alignment) {
  switch (alignment) {
    case Alignment::kSe3:
      return "SE(3), least squares over all positions, scale fixed at 1";
    case Alignment::kFirst:
      return "first poses made equal";
    case Alignment::kNone:
      break;
  }
  return "none, both in one world frame";
}

std::string DescribeErrors(const TrajectoryErrors& errors, Alignment alignment) {
  std::string text =
      fmt::format("{} pairs of poses, {:.3f} m along the truth\n", errors.poses, errors.length_m);
  text += fmt::format("APE, position, alignment: {}\n", DescribeAlignment(alignment));
  text += fmt::format("  rmse {:.4f} m  mean {:.4f} m  max {:.4f} m\n", errors.ape_rmse_m,
                      errors.ape_mean_m, errors.ape_max_m);
  text += "RPE, over one frame, root mean square over all frames\n";
  text += fmt::format("  {:.4f} m  {:.4f} deg\n", errors.rpe_rmse_m, errors.rpe_rmse_deg);
  text += fmt::format("End from start of the estimate: {:.4f} m\n", errors.first_to_last_m);
  text += "Short segments, mean over all of a length, every frame a start\n";
  text += SegmentTable(errors.short_segments);
  text += "KITTI segments, mean over all of a length, every 10th frame a start\n";
  if (std::isnan(errors.kitti_trel_percent)) {
    return text + "  no segment of 100 m or more: the path is too short\n";
  }
  text += SegmentTable(errors.kitti_segments);
  text +=
      fmt::format("  mean over all segments of 100..800 m: t_rel {:.4f} %  r_rel {:.5f} deg/m\n",
                  errors.kitti_trel_percent, errors.kitti_rrel_deg_per_m);
  return text;
}

std::string DescribeMapQuality(const MapQualityReport& report, const MapQualityOptions& options) {
  std::string text = fmt::format(
      "Map quality without truth: {} scans, points at {:g}..{:g} m, voxels of {:g} m with at least "
      "{} points of {} scans\n",
      report.scans, options.min_range_m, options.max_range_m, options.voxel_size_m,
      options.min_points, options.min_frames);
  text +=
      "MME: mean over voxels; thickness: over planar voxels. Lower is better. Compare "
      "trajectories by\n";
  text += fmt::format("the columns \"common\": the {} voxels that all share, {} of them planar.\n",
                      report.common_voxels, report.common_planar_voxels);
  size_t width = 10;
  for (const MapQuality& q : report.trajectories) width = std::max(width, q.name.size());
  text += fmt::format("{:{}}  {:>8} {:>8} {:>9} {:>9} {:>9} {:>10} {:>10}\n", "", width, "", "", "",
                      "thick mm", "thick mm", "MME", "thick mm");
  text += fmt::format("{:{}}  {:>8} {:>8} {:>9} {:>9} {:>9} {:>10} {:>10}\n", "trajectory", width,
                      "voxels", "planar", "MME", "mean", "median", "common", "common");
  for (const MapQuality& q : report.trajectories) {
    text += fmt::format("{:{}}  {:>8} {:>8} {} {} {} {} {}\n", q.name, width, q.voxels,
                        q.planar_voxels, Cell(q.mme, 9, 4), Cell(q.thickness_mean_mm, 9, 3),
                        Cell(q.thickness_median_mm, 9, 3), Cell(q.common_mme, 10, 4),
                        Cell(q.common_thickness_mm, 10, 3));
    if (q.points_beyond_grid == 0) continue;
    text += fmt::format("  {} points of {} are too far away to count: has it flown apart?\n",
                        q.points_beyond_grid, q.name);
  }
  return text;
}

nlohmann::json ToJson(const TrajectoryErrors& errors, Alignment alignment) {
  return {{"alignment", DescribeAlignment(alignment)},
          {"poses", errors.poses},
          {"length_m", errors.length_m},
          {"ape_rmse_m", errors.ape_rmse_m},
          {"ape_mean_m", errors.ape_mean_m},
          {"ape_max_m", errors.ape_max_m},
          {"rpe_rmse_m", errors.rpe_rmse_m},
          {"rpe_rmse_deg", errors.rpe_rmse_deg},
          {"first_to_last_m", errors.first_to_last_m},
          {"short_segments", SegmentsToJson(errors.short_segments)},
          {"kitti_segments", SegmentsToJson(errors.kitti_segments)},
          {"kitti_trel_percent", errors.kitti_trel_percent},
          {"kitti_rrel_deg_per_m", errors.kitti_rrel_deg_per_m}};
}

nlohmann::json ToJson(const MapQualityReport& report, const MapQualityOptions& options) {
  nlohmann::json list = nlohmann::json::array();
  for (const MapQuality& q : report.trajectories) {
    list.push_back({{"name", q.name},
                    {"voxels", q.voxels},
                    {"planar_voxels", q.planar_voxels},
                    {"mme", q.mme},
                    {"thickness_mean_mm", q.thickness_mean_mm},
                    {"thickness_median_mm", q.thickness_median_mm},
                    {"common_mme", q.common_mme},
                    {"common_thickness_mm", q.common_thickness_mm},
                    {"points_beyond_grid", q.points_beyond_grid}});
  }
  return {{"scans", report.scans},
          {"voxel_size_m", options.voxel_size_m},
          {"min_range_m", options.min_range_m},
          {"max_range_m", options.max_range_m},
          {"min_points", options.min_points},
          {"min_frames", options.min_frames},
          {"common_voxels", report.common_voxels},
          {"common_planar_voxels", report.common_planar_voxels},
          {"trajectories", list}};
}

}  // namespace lamina
