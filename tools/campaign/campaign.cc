#include "tools/campaign/campaign.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>
#include <system_error>

#include "config/config.h"
#include "config/yaml_options.h"
#include "core/base/error.h"
#include "core/base/printable_text.h"
#include "core/base/stopwatch.h"
#include "core/geometry/state_archive.h"
#include "io/file/folder_writer.h"
#include "tools/campaign/together.h"
#include "tools/cli/common.h"
#include "tools/merge/drive.h"
#include "tools/merge/keyframe_level.h"
#include "tools/merge/merge_results.h"
#include "tools/merge/merged_map.h"
#include "tools/results/output_folder.h"
#include "tools/results/verdict/process_report.h"
#include "tools/run/command.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// In each folder of results: of what they were made.
constexpr char kMadeOf[] = "campaign.yaml";

enum class Status { kMapped, kThere, kLeftOut };
const char* ToString(Status status) {
  switch (status) {
    case Status::kMapped:
      return "mapped";
    case Status::kThere:
      return "there already";
    case Status::kLeftOut:
      return "left out";
  }
  return "unknown";
}

// What became of a recording.
struct Outcome {
  Status status = Status::kLeftOut;
  std::string reason;  // why it is left out, or doubtful

  void Archive(StateArchive& a) { a(&status, &reason); }
};

FolderWriter NewFolder(const fs::path& target) { return {target, target.string() + ".part"}; }

void Finish(const std::string& made_of, FolderWriter* folder) {
  WriteTextFile((fs::path(folder->path()) / kMadeOf).string(), made_of);
  folder->Replace();
}

// All files of a folder, or of the one; what cannot be looked at counts nothing.
std::uintmax_t BytesOf(const std::string& path) {
  std::error_code ignored;
  if (!fs::is_directory(path, ignored)) {
    const std::uintmax_t bytes = fs::file_size(path, ignored);
    return ignored ? 0 : bytes;
  }
  std::uintmax_t sum = 0;
  for (fs::recursive_directory_iterator entry(path, ignored), end; !ignored && entry != end;
       entry.increment(ignored)) {
    std::error_code unknown;
    const std::uintmax_t bytes = entry->file_size(unknown);
    if (!unknown) sum += bytes;
  }
  return sum;
}

class Campaign {
 public:
  Campaign(const CampaignArguments& arguments, const Ranks& ranks)
      : arguments_(arguments), ranks_(ranks), stop_(StopOnSignals()) {}

  int Run() {
    Together(ranks_, [&] { Prepare(); });
    Stopwatch watch;
    Map();
    const double map_s = 1e-3 * watch.LapMilliseconds();
    const std::string maps = Join();
    if (ranks_.rank() > 0) return 0;
    Report(map_s, 1e-3 * watch.LapMilliseconds());
    fmt::print("{} recordings on {} ranks: {} mapped, {} there already, {} left out; {}\n",
               recordings_.size(), ranks_.size(), Count(Status::kMapped), Count(Status::kThere),
               LeftOut(), maps);
    fmt::print("drives   {0}/drives\nmap      {0}/map\nfigures  {0}/campaign.json\n",
               arguments_.out);
    return LeftOut() > 0 ? 1 : 0;
  }

 private:
  void Prepare() {
    recordings_ = ReadRecordingList(arguments_.recordings);
    config_ = LoadConfig(arguments_.config.file, arguments_.config.set);
    config_.loops.enabled = true;
    if (IsSession(arguments_.out)) {
      throw OptionError(fmt::format("--out {}: is a session of `lamina watch`", arguments_.out));
    }
    for (const ListedRecording& recording : recordings_) {
      if (!IsWithin(arguments_.out, recording.scans)) continue;
      throw OptionError(fmt::format("--out {}: is in the folder of the recording, {}",
                                    arguments_.out, recording.scans));
    }
    if (ranks_.rank() == 0) MakeDirectory(Drive("").string());
  }

  fs::path Drive(const std::string& name) const {
    return fs::path(arguments_.out) / "drives" / name;
  }
  // Of recording i. Its size tells that it has grown or was replaced.
  std::string MadeOf(std::size_t i) const {
    const ListedRecording& recording = recordings_[i];
    return fmt::format("# scans: {}\n# bytes: {}\n# frames: {}\n# topic: {}\n{}", recording.scans,
                       bytes_[i], recording.frames, recording.topic, ResultOptionsToYaml(config_));
  }

  void Map() {
    for (const ListedRecording& recording : recordings_) bytes_.push_back(BytesOf(recording.scans));
    // Files may grow meanwhile: what rank 0 sees counts.
    StateArchive sizes;
    sizes(&bytes_);
    const std::vector<std::string> seen = ranks_.Exchange(sizes.written());
    StateArchive of_first(seen.front());
    of_first(&bytes_);
    const std::vector<std::size_t> owner = DealOut(bytes_, ranks_.size());
    std::vector<Outcome> mine;
    Together(ranks_, [&] {
      for (std::size_t i = 0; i < recordings_.size(); ++i) {
        if (owner[i] == ranks_.rank()) mine.push_back(MapOne(i));
      }
    });
    outcomes_ =
        ShareOut<Outcome>(owner, Sharing(), [&](const std::vector<std::size_t>&) { return mine; });
  }

  Outcome MapOne(std::size_t i) const {
    const ListedRecording& recording = recordings_[i];
    if (stop_) throw InterruptedError("what is mapped until now is kept; start it again to go on");
    const std::string made_of = MadeOf(i);
    const fs::path drive = Drive(recording.name);
    if (HoldsText(drive / kMadeOf, made_of) &&
        (!ByKeyframes() || fs::exists(drive / kKeyframeFileName))) {
      return {Status::kThere, ""};
    }
    if (fs::exists(drive / kMadeOf)) {
      spdlog::warn("{}: was made of other scans or with other options, and is made anew",
                   Printable(drive.string()));
    }
    Stopwatch watch;
    FolderWriter folder = NewFolder(Drive(recording.name));
    RunArguments run;
    run.scans = recording.scans;
    run.frames = recording.frames;
    run.out = folder.path();
    run.config = arguments_.config;
    if (!recording.topic.empty()) run.config.set.push_back("scans.topic=" + recording.topic);
    run.loops = "on";
    run.progress = "off";
    run.keyframes = ByKeyframes();
    run.quiet = true;
    Outcome outcome{Status::kMapped, ""};
    try {
      if (RunRecording(run) != 0) outcome.reason = "poses are probably wrong";
    } catch (const InputError& error) {
      return LeaveOut(recording, error.what());
    } catch (const OptionError& error) {
      return LeaveOut(recording, error.what());
    }
    Finish(made_of, &folder);
    spdlog::info("rank {}: {} mapped in {:.1f} s{}{}", ranks_.rank(), recording.name,
                 1e-3 * watch.Milliseconds(), outcome.reason.empty() ? "" : "; ", outcome.reason);
    return outcome;
  }

  Outcome LeaveOut(const ListedRecording& recording, const std::string& why) const {
    spdlog::error("rank {}: {} is left out: {}", ranks_.rank(), recording.name, why);
    return {Status::kLeftOut, why};
  }

  // Returns what came of it, in words.
  std::string Join() {
    std::string made_of = ResultOptionsToYaml(config_);
    std::vector<std::string> folders;
    Together(ranks_, [&] {
      for (std::size_t i = 0; i < recordings_.size(); ++i) {
        if (outcomes_[i].status == Status::kLeftOut) continue;
        folders.push_back(Drive(recordings_[i].name).string());
        made_of += fmt::format("# drive: {}\n{}", recordings_[i].name, MadeOf(i));
      }
      if (folders.empty()) throw InputError("not one of the recordings could be mapped");
    });
    if (ByKeyframes()) made_of += KeyframesToText();
    const fs::path target = fs::path(arguments_.out) / "map";
    // What was mapped just now is the same only if a kept map was made of it.
    const bool there = Count(Status::kMapped) == 0 && HoldsText(target / kMadeOf, made_of);
    if (ranks_.Exchange(there ? "y" : "n").front() == "y") return "their map is there already";
    std::vector<lamina::Drive> drives;
    Together(ranks_, [&] {
      for (const std::string& folder : folders) drives.push_back(ReadDrive(folder));
      SortByAge(&drives);
    });
    MergedMap merged(drives, config_, MergedMap::Effort::kJoin, {}, Sharing());
    std::vector<KeyframeBundleResult> keyframes;
    if (ByKeyframes()) {
      const KeyframeLevelOptions options{
          arguments_.keyframes, arguments_.scratch.empty() ? arguments_.out : arguments_.scratch};
      keyframes = AdjustKeyframesOf(drives, config_, options, Sharing(), &merged);
      TellOf(keyframes);
    }
    Together(ranks_, [&] {
      if (ranks_.rank() > 0) return;
      FolderWriter folder = NewFolder(target);
      nlohmann::json summary = WriteMerge(folder.path(), drives, merged, config_);
      if (ByKeyframes()) summary["keyframes"] = ToJson(keyframes);
      WriteTextFile((fs::path(folder.path()) / "summary.json").string(), SummaryText(summary));
      Finish(made_of, &folder);
    });
    return merged.frames() == 1 ? "one map"
                                : fmt::format("{} maps that nothing connects", merged.frames());
  }

  bool ByKeyframes() const { return arguments_.level == "keyframes"; }
  // Of what a map by keyframes is made, beside its drives.
  std::string KeyframesToText() const {
    KeyframeBundleOptions options = arguments_.keyframes;
    return "# level: keyframes\n" +
           OptionsToYaml([&](OptionVisitor& v) { v.Group("keyframes", &options); });
  }
  void TellOf(const std::vector<KeyframeBundleResult>& frames) const {
    if (ranks_.rank() > 0) return;
    for (const KeyframeBundleResult& frame : frames) {
      for (std::size_t i = 0; i < frame.rounds.size(); ++i) {
        const KeyframeRound& round = frame.rounds[i];
        spdlog::info(
            "round {} of {} keyframes: {} planes, {} observations in {} tiles, {} blocks; cost "
            "{:.6g} -> {:.6g} in {} steps, moved {:.4f} m; {:.2f} s to build, {:.2f} s to solve, "
            "{} bytes of other ranks",
            i, frame.poses.size(), round.planes, round.observations, frame.tiles, round.blocks,
            round.initial_cost, round.final_cost, round.iterations, round.moved_m, round.build_s,
            round.solve_s, round.bytes_received);
      }
      if (!frame.refusal.empty())
        spdlog::warn("keyframes stay as submaps have them: {}", frame.refusal);
    }
  }

  WorkSharing Sharing() const {
    return {ranks_.rank(), ranks_.size(),
            [this](const std::string& bytes) { return ranks_.Exchange(bytes); },
            [this](const std::string& bytes) { return ranks_.Gather(bytes); }};
  }

  std::size_t Count(Status status) const {
    return static_cast<std::size_t>(
        std::count_if(outcomes_.begin(), outcomes_.end(),
                      [&](const Outcome& outcome) { return outcome.status == status; }));
  }
  std::size_t LeftOut() const { return Count(Status::kLeftOut); }

  void Report(double map_s, double join_s) const {
    nlohmann::json json = {{"ranks", ranks_.size()}, {"map_s", map_s}, {"join_s", join_s}};
    json["recordings"] = nlohmann::json::array();
    for (std::size_t i = 0; i < recordings_.size(); ++i) {
      json["recordings"].push_back({{"name", recordings_[i].name},
                                    {"scans", recordings_[i].scans},
                                    {"status", ToString(outcomes_[i].status)},
                                    {"reason", outcomes_[i].reason}});
    }
    WriteTextFile((fs::path(arguments_.out) / "campaign.json").string(), SummaryText(json));
  }

  const CampaignArguments& arguments_;
  const Ranks& ranks_;
  const std::atomic<bool>& stop_;
  std::vector<ListedRecording> recordings_;
  LaminaConfig config_;
  std::vector<std::uintmax_t> bytes_;  // of each recording, as rank 0 sees them
  std::vector<Outcome> outcomes_;      // of each recording
};

}  // namespace

std::vector<std::size_t> DealOut(const std::vector<std::uintmax_t>& bytes, std::size_t ranks) {
  std::vector<std::size_t> order(bytes.size()), owner(bytes.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return bytes[a] > bytes[b]; });
  std::vector<std::uintmax_t> load(ranks, 0);
  for (const std::size_t i : order) {
    owner[i] = static_cast<std::size_t>(std::min_element(load.begin(), load.end()) - load.begin());
    // One that counts nothing is work as well.
    load[owner[i]] += bytes[i] + 1;
  }
  return owner;
}

int RunCampaign(const CampaignArguments& arguments, const Ranks& ranks) {
  const auto limit = LimitThreads(arguments.threads);
  return Campaign(arguments, ranks).Run();
}

}  // namespace lamina
