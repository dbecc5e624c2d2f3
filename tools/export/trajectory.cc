#include "tools/export/trajectory.h"

#include <fmt/format.h>

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <vector>

#include "core/base/error.h"
#include "io/file/folder_list.h"
#include "io/map/trajectory_io.h"
#include "tools/cli/common.h"
#include "tools/results/piece_poses.h"

namespace lamina {
namespace {

using Pieces = std::map<std::int64_t, Trajectory>;

std::string StampText(StampNs stamp_ns) {
  std::string text;
  AppendSeconds(stamp_ns, &text);
  return text;
}

// Piece by piece. `rows`: one for each pose, or none.
std::string CsvText(const Trajectory& poses, const std::vector<FrameRow>& rows) {
  const bool known = !rows.empty() && !rows.front().covariance.empty();
  std::string text = "stamp_s,x,y,z,qx,qy,qz,qw,piece";
  if (!rows.empty()) text += ",status";
  text += known ? ",cov_rx,cov_ry,cov_rz,cov_x,cov_y,cov_z\n" : "\n";
  std::map<std::int64_t, std::string> pieces;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const std::int64_t piece = rows.empty() ? 0 : rows[i].piece;
    const SE3& T = poses[i].T_world_lidar;
    std::string& lines = pieces[piece];
    lines += fmt::format("{},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{:.9g},{}",
                         StampText(poses[i].stamp_ns), T.t.x(), T.t.y(), T.t.z(), T.q.x(), T.q.y(),
                         T.q.z(), T.q.w(), piece);
    if (!rows.empty()) lines += "," + rows[i].status;
    if (known) lines += "," + rows[i].covariance;
    lines += "\n";
  }
  for (const auto& [piece, lines] : pieces) text += lines;
  return text;
}

std::string GeoJsonText(const Pieces& pieces) {
  nlohmann::ordered_json json = {{"type", "FeatureCollection"},
                                 {"features", nlohmann::ordered_json::array()}};
  for (const auto& [piece, poses] : pieces) {
    nlohmann::ordered_json line = nlohmann::ordered_json::array();
    for (const StampedPose& pose : poses) {
      const Eigen::Vector3d& t = pose.T_world_lidar.t;
      line.push_back({t.x(), t.y(), t.z()});
    }
    // A line has two places at least.
    const bool point = poses.size() == 1;
    json["features"].push_back(
        {{"type", "Feature"},
         {"geometry",
          {{"type", point ? "Point" : "LineString"}, {"coordinates", point ? line[0] : line}}},
         {"properties",
          {{"piece", piece},
           {"poses", poses.size()},
           {"first_stamp_s", StampText(poses.front().stamp_ns)},
           {"last_stamp_s", StampText(poses.back().stamp_ns)},
           {"frame", "local, metres"}}}});
  }
  return json.dump(1) + "\n";
}

}  // namespace

std::size_t ExportTrajectory(const std::string& run, const std::string& path) {
  const std::string file = (std::filesystem::path(run) / "trajectory_tum.txt").string();
  const std::string ending = LowerEnding(path);
  if (ending != ".csv" && ending != ".geojson") {
    throw OptionError(fmt::format("--trajectory {}: the name must end in .csv or .geojson", path));
  }
  const Trajectory poses = ReadTrajectory(file);
  WriteTextFile(path, ending == ".csv" ? CsvText(poses, ReadPosedRows(run, poses))
                                       : GeoJsonText(SplitIntoPieces(file, poses)));
  return poses.size();
}

}  // namespace lamina
