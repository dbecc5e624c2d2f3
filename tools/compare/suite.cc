#include "tools/compare/suite.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <memory>

#include "core/base/error.h"
#include "io/map/trajectory_io.h"
#include "tools/synth/writer.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

std::vector<SE3> PosesOf(const Trajectory& trajectory) {
  std::vector<SE3> poses;
  for (const StampedPose& pose : trajectory) poses.push_back(pose.T_world_lidar);
  return poses;
}

// Quick scans: a ninth of the rays in a third of the planes.
StationOptions Stations(StationScene scene, int seed, bool quick) {
  StationOptions options;
  options.scene = scene;
  options.seed = seed;
  if (quick) {
    options.scans = 6;
    options.lines = 80;
    options.ray_step = 3;
  }
  return options;
}

// Words of a folder's path that name a sequence of the data set.
struct EthzName {
  const char* name;
  std::vector<std::string> words;
};

const std::vector<EthzName>& EthzNames() {
  static const std::vector<EthzName> names = {{"apartment", {"apartment"}},
                                              {"hauptgebaeude", {"haupt"}},
                                              {"stairs", {"stairs"}},
                                              {"plain", {"plain"}},
                                              {"gazebo_summer", {"gazebo", "summer"}},
                                              {"gazebo_winter", {"gazebo", "winter"}},
                                              {"wood_summer", {"wood", "summer"}},
                                              {"wood_autumn", {"wood", "autumn"}}};
  return names;
}

bool Matches(const EthzName& name, std::string path) {
  std::transform(path.begin(), path.end(), path.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return std::all_of(name.words.begin(), name.words.end(),
                     [&](const std::string& word) { return path.find(word) != std::string::npos; });
}

// The poses lie with the scans, or beside or above their folder.
fs::path FindPoses(const fs::path& scans, const fs::path& root) {
  for (fs::path folder = scans;; folder = folder.parent_path()) {
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
      if (entry.path().filename() == "pose_scanner_leica.csv") return entry.path();
    }
    // No farther than the folder of this sequence.
    if (folder.parent_path() == root || folder == root) return {};
  }
}

}  // namespace

CompareSequence OpenSequence(const std::string& name, const std::string& scans,
                             const std::string& truth, const std::string& reference,
                             const CompareConfig& config) {
  const auto source = OpenScans(scans, config.lamina.scans);
  CompareSequence sequence;
  sequence.name = name;
  sequence.truth = PosesOf(CameraToLidar(ReadTrajectory(truth), source->T_camera_lidar()));
  if (sequence.truth.size() != source->size()) {
    throw InputError(fmt::format("{}: holds {} poses for {} scans; one for each scan is needed",
                                 truth, sequence.truth.size(), source->size()));
  }
  if (source->size() < 2) {
    throw InputError(fmt::format("{}: holds one scan, two at least are needed", scans));
  }
  sequence.identity = fs::weakly_canonical(scans).string() + config.lamina.scans.topic;
  for (std::size_t i = 0; i < source->size(); ++i) {
    std::error_code ignored;
    sequence.identity += fmt::format(" {}", fs::file_size(source->Name(i), ignored));
  }
  sequence.open = [scans, reference] { return CompareFiles{scans, reference}; };
  return sequence;
}

std::vector<CompareSequence> EthzLikeSequences(const std::string& folder, int seed, bool quick,
                                               bool keep) {
  std::vector<CompareSequence> sequences;
  for (std::size_t i = 0; i < StationSceneNames().size(); ++i) {
    const auto scene = static_cast<StationScene>(i);
    if (quick && scene != StationScene::kHauptgebaeude && scene != StationScene::kGazeboWinter) {
      continue;
    }
    const StationOptions options = Stations(scene, seed, quick);
    CompareSequence sequence;
    sequence.name = StationSceneNames()[i];
    sequence.identity =
        fmt::format("{} scans {} seed {} noise {} lines {} step {}", sequence.name, options.scans,
                    options.seed, options.noise_m, options.lines, options.ray_step);
    sequence.truth = PosesOf(StationSequence(options).Truth());
    const fs::path path = fs::path(folder) / sequence.name;
    sequence.open = [options, path] {
      WriteStations(options, StationLayout::kKitti, path.string());
      return CompareFiles{path.string(), (path / "reference.ply").string()};
    };
    sequence.close = [path, keep] {
      std::error_code ignored;
      if (!keep) fs::remove_all(path, ignored);
    };
    sequences.push_back(std::move(sequence));
  }
  return sequences;
}

std::vector<CompareSequence> EthzSequences(const std::string& folder, const CompareConfig& config) {
  std::error_code error;
  const fs::path root = fs::weakly_canonical(folder, error);
  if (!fs::is_directory(root, error)) throw InputError(folder + ": is not a folder");
  std::vector<fs::path> found;
  for (const auto& entry : fs::recursive_directory_iterator(root)) {
    if (entry.path().filename() == "Hokuyo_0.csv") found.push_back(entry.path().parent_path());
  }
  std::sort(found.begin(), found.end());
  std::vector<CompareSequence> sequences;
  for (const EthzName& name : EthzNames()) {
    const auto scans = std::find_if(found.begin(), found.end(), [&](const fs::path& path) {
      return Matches(name, fs::relative(path, root).string());
    });
    if (scans == found.end()) {
      spdlog::warn("{}: has no folder of {} with Hokuyo_0.csv; it is left out", folder, name.name);
      continue;
    }
    const fs::path poses = FindPoses(*scans, root);
    if (poses.empty()) {
      throw InputError(scans->string() + ": there is no pose_scanner_leica.csv with these scans");
    }
    sequences.push_back(OpenSequence(name.name, scans->string(), poses.string(), "", config));
  }
  if (sequences.empty()) {
    throw InputError(folder +
                     ": holds none of the sequences of the ETHZ data set (folders with "
                     "Hokuyo_0.csv, named apartment, hauptgebaude, stairs, plain, "
                     "gazebo_summer, gazebo_winter, wood_summer, wood_autumn)");
  }
  return sequences;
}

}  // namespace lamina
