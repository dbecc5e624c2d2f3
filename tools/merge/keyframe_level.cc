#include "tools/merge/keyframe_level.h"

#include <fmt/format.h>

#include <deque>
#include <filesystem>
#include <memory>
#include <utility>

#include "backend/tiles/keyframe_ties.h"
#include "core/base/error.h"
#include "io/store/byte_file.h"
#include "tools/results/graph_file.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// The keyframes of some submaps, in their order, out of the files of their drives.
class SubmapKeyframes final : public KeyframeSource {
 public:
  SubmapKeyframes(const MergedMap& merged, const std::vector<std::size_t>& submaps,
                  std::deque<KeyframeFile>* files)
      : files_(files) {
    for (const std::size_t i : submaps) {
      const MergedMap::Origin& origin = merged.origin(i);
      for (const SubmapKeyframe& keyframe : origin.submap->keyframes)
        places_.push_back({origin.drive, origin.piece, keyframe.id});
    }
  }
  std::size_t size() const override { return places_.size(); }
  std::vector<PackedCluster> Read(std::size_t keyframe) const override {
    const Place& place = places_[keyframe];
    return (*files_)[place.drive].Read(place.piece, place.id);
  }

 private:
  struct Place {
    std::size_t drive = 0;
    std::int64_t piece = 0, id = 0;
  };
  std::deque<KeyframeFile>* files_;
  std::vector<Place> places_;
};

std::deque<KeyframeFile> OpenFiles(const std::vector<Drive>& drives) {
  std::deque<KeyframeFile> files;
  for (const Drive& drive : drives) {
    const std::string path = (fs::path(drive.folder) / kKeyframeFileName).string();
    if (!fs::exists(path)) {
      throw InputError(fmt::format("{}: has no {}", drive.folder, kKeyframeFileName));
    }
    files.emplace_back(path);
    for (const SubmapFrame& frame : drive.frames) {
      for (std::size_t i = 0; i < frame.submaps.size(); ++i) {
        for (const SubmapKeyframe& keyframe : frame.submaps[i].keyframes) {
          if (files.back().Has(frame.pieces[i], keyframe.id)) continue;
          throw InputError(fmt::format("{}: keyframe {} of piece {} is missing", path, keyframe.id,
                                       frame.pieces[i]));
        }
      }
    }
  }
  return files;
}

}  // namespace

std::vector<KeyframeBundleResult> AdjustKeyframesOf(const std::vector<Drive>& drives,
                                                    const LaminaConfig& config,
                                                    const KeyframeLevelOptions& options,
                                                    const WorkSharing& sharing, MergedMap* merged) {
  std::deque<KeyframeFile> files = OpenFiles(drives);
  int stores = 0;
  const MakeStore make_store = [&] {
    const std::string name = fmt::format("keyframes_{}_{}", sharing.part, stores++);
    return std::make_unique<ByteFile>((fs::path(options.scratch) / name).string(),
                                      ByteFile::Lifetime::kScratch);
  };
  const std::vector<std::vector<SE3>> start = merged->KeyframePoses();
  std::vector<std::vector<SE3>> poses = start;
  std::vector<KeyframeBundleResult> results;
  for (std::size_t frame = 0; frame < merged->frames(); ++frame) {
    const std::vector<std::size_t>& members = merged->SubmapsOfFrame(frame);
    std::vector<const Submap*> submaps;
    std::vector<SE3> initial;
    for (const std::size_t i : members) {
      submaps.push_back(merged->origin(i).submap);
      initial.insert(initial.end(), start[i].begin(), start[i].end());
    }
    const BundleProblem ties =
        TiesOfKeyframes(submaps, PartOfGraph(merged->graph(), members), initial, config.loops);
    const SubmapKeyframes keyframes(*merged, members, &files);
    results.push_back(AdjustKeyframes(keyframes, ties, options.bundle, config.map,
                                      config.backend.window, sharing, make_store));
    auto pose = results.back().poses.begin();
    for (const std::size_t i : members) {
      for (SE3& T : poses[i]) T = *pose++;
    }
  }
  if (sharing.part > 0) return results;
  merged->MoveKeyframes(start, poses, [&](std::size_t submap, std::size_t keyframe) {
    const MergedMap::Origin& origin = merged->origin(submap);
    return files[origin.drive].Read(origin.piece, origin.submap->keyframes[keyframe].id);
  });
  return results;
}

nlohmann::json ToJson(const std::vector<KeyframeBundleResult>& frames) {
  nlohmann::json json = nlohmann::json::array();
  for (std::size_t f = 0; f < frames.size(); ++f) {
    const KeyframeBundleResult& frame = frames[f];
    nlohmann::json rounds = nlohmann::json::array();
    for (const KeyframeRound& round : frame.rounds) {
      rounds.push_back({{"planes", round.planes},
                        {"observations", round.observations},
                        {"blocks", round.blocks},
                        {"iterations", round.iterations},
                        {"cost_before", round.initial_cost},
                        {"cost", round.final_cost},
                        {"moved_m", round.moved_m},
                        {"moved_rad", round.moved_rad}});
    }
    json.push_back({{"frame", f},
                    {"keyframes", frame.poses.size()},
                    {"tiles", frame.tiles},
                    {"misfit_before_m", frame.initial_misfit_m},
                    {"misfit_m", frame.final_misfit_m},
                    {"refusal", frame.refusal},
                    {"rounds", rounds}});
  }
  return json;
}

}  // namespace lamina
