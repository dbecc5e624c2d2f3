#include "tools/results/recording_part.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <charconv>
#include <filesystem>
#include <numeric>

#include "core/base/error.h"
#include "io/map/trajectory_io.h"
#include "tools/metrics/match.h"
#include "tools/results/posed_scans.h"
#include "tools/results/run_summary.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

std::optional<std::size_t> NumberIn(const std::string& file) {
  const std::string stem = fs::path(file).stem().string();
  std::size_t number = 0;
  const auto [rest, error] = std::from_chars(stem.data(), stem.data() + stem.size(), number);
  const bool whole = !stem.empty() && error == std::errc() && rest == stem.data() + stem.size();
  return whole ? std::optional(number) : std::nullopt;
}

// Those of data sets as large as any; stamps as names are far above it.
constexpr std::size_t kMostLines = 100'000'000;
constexpr std::size_t kMostMissing = 10'000;

}  // namespace

RecordingPart PartOf(const ScanSource& scans, const FrameRange& range) {
  RecordingPart part{scans.size(), range.begin, range.end, std::nullopt, {}};
  const std::optional<std::size_t> first = NumberIn(scans.Name(0));
  if (!first || *first > kMostLines) return part;
  std::vector<std::size_t> missing;
  std::size_t next = *first;
  for (std::size_t i = 0; i < scans.size(); ++i, ++next) {
    const std::optional<std::size_t> number = NumberIn(scans.Name(i));
    // Names that are no numbers of scans jump by more.
    if (!number || *number < next || *number - next > kMostMissing - missing.size()) return part;
    for (; next < *number; ++next) missing.push_back(next);
  }
  part.first_number = first;
  part.missing_numbers = std::move(missing);
  return part;
}

std::size_t RecordingPart::NumberOf(std::size_t i) const {
  std::size_t number = first_number.value_or(0) + i;
  for (const std::size_t missing : missing_numbers) number += missing <= number ? 1 : 0;
  return number;
}

nlohmann::json ToJson(const RecordingPart& part) {
  nlohmann::json json = {{"scans", part.scans}, {"begin", part.begin}, {"end", part.end}};
  if (part.first_number) json["first_number"] = *part.first_number;
  if (!part.missing_numbers.empty()) json["missing_numbers"] = part.missing_numbers;
  return json;
}

std::optional<RecordingPart> ReadRecordingPart(const std::string& folder) {
  const nlohmann::json json = ReadSummaryIfAny(folder).value("recording", nlohmann::json());
  const auto number = [&](const char* name) -> std::optional<std::size_t> {
    if (!json.is_object() || !json.contains(name) || !json[name].is_number_unsigned()) return {};
    return json[name].get<std::size_t>();
  };
  const auto scans = number("scans"), begin = number("begin"), end = number("end");
  if (!scans || !begin || !end || *begin >= *end || *end > *scans) return std::nullopt;
  RecordingPart part{*scans, *begin, *end, number("first_number"), {}};
  const nlohmann::json missing = json.value("missing_numbers", nlohmann::json::array());
  for (const nlohmann::json& one : missing) {
    if (one.is_number_unsigned()) part.missing_numbers.push_back(one.get<std::size_t>());
  }
  return part;
}

namespace {

// The lines (from 0) of the part's scans in a file of so many poses without stamps: that has one for
// each scan of the part, one for each of the recording, or more than that, if the scans are named by
// their numbers in it. Throws InputError, naming `path`, for any other count.
std::vector<std::size_t> LinesOf(const RecordingPart& part, std::size_t lines,
                                 const std::string& path) {
  std::vector<std::size_t> of(part.size());
  std::iota(of.begin(), of.end(), lines == part.size() ? 0 : part.begin);
  if (lines == part.size() || lines == part.scans) return of;
  if (!part.first_number || part.NumberOf(part.scans - 1) >= lines) {
    const std::string scans = part.size() == part.scans
                                  ? fmt::format("{} scans", part.scans)
                                  : fmt::format("{} of {} scans", part.size(), part.scans);
    throw InputError(
        fmt::format("{}: has {} poses without stamps for {}; there must be one for each scan, so "
                    "they do not belong together",
                    path, lines, scans));
  }
  for (std::size_t& line : of) line = part.NumberOf(line);
  return of;
}

}  // namespace

Trajectory ReadPosesOfPart(const std::string& path, const RecordingPart& part,
                           const std::vector<StampNs>& stamps, std::size_t* first_line) {
  Trajectory poses = ReadTrajectory(path);
  if (first_line != nullptr) *first_line = 0;
  // The ETHZ data set's poses are those of its scans by their lines, whatever their stamps are.
  const bool by_line = !stamps.empty() && fs::path(path).extension() == ".csv";
  if (HasStamps(poses) && !by_line) return poses;
  const std::vector<std::size_t> lines = LinesOf(part, poses.size(), path);
  if (first_line != nullptr) *first_line = lines.front();
  if (poses.size() > part.size()) {
    spdlog::info("{}: {} poses of its {}, from {} to {}, are those of the scans", path, part.size(),
                 poses.size(), lines.front(), lines.back());
  }
  Trajectory cut;
  for (std::size_t i = 0; i < part.size(); ++i) {
    const StampNs stamp = stamps.empty() ? static_cast<StampNs>(i) : stamps.at(part.begin + i);
    cut.push_back({stamp, poses[lines[i]].T_world_lidar});
  }
  return cut;
}

Trajectory ReadTruthOfPart(const std::string& path, const ScanSource& source,
                           const RecordingPart& part) {
  const std::vector<StampNs> stamps = ScanStamps(source);
  const Trajectory truth = ReadPosesOfPart(path, part, stamps);
  NamedTrajectory scans{path, {}};
  for (std::size_t i = part.begin; i < part.end; ++i) scans.poses.push_back({stamps[i], SE3()});
  if (scans.poses.size() > 1) MatchToTruth(scans, truth, kStampToleranceS);
  return CameraToLidar(truth, source.T_camera_lidar());
}

}  // namespace lamina
