#include "tools/merge/command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "tools/cli/common.h"
#include "tools/cli/options.h"
#include "tools/merge/drive.h"
#include "tools/merge/merge_results.h"
#include "tools/merge/merged_map.h"
#include "tools/results/output_folder.h"
#include "tools/results/verdict/process_report.h"

namespace lamina {
namespace {

struct MergeArguments {
  std::vector<std::string> drives;
  std::string out;
  ConfigArguments config;
  int threads = 0;
};

std::vector<Drive> ReadDrives(const MergeArguments& arguments) {
  std::vector<Drive> drives;
  for (const std::string& folder : arguments.drives) {
    std::error_code ignored;
    if (std::filesystem::equivalent(folder, arguments.out, ignored))
      throw OptionError(fmt::format("--out {}: is one of the drives", arguments.out));
    drives.push_back(ReadDrive(folder));
  }
  SortByAge(&drives);
  return drives;
}

// The most frequent of these reasons, with their counts (summary.json).
std::string DescribeRefusals(const std::map<std::string, std::size_t>& by_reason) {
  constexpr std::size_t kMost = 3;
  std::vector<std::pair<std::string, std::size_t>> reasons(by_reason.begin(), by_reason.end());
  std::stable_sort(reasons.begin(), reasons.end(),
                   [](const auto& a, const auto& b) { return a.second > b.second; });
  std::string text;
  for (std::size_t i = 0; i < std::min(kMost, reasons.size()); ++i) {
    const auto& [reason, count] = reasons[i];
    text += fmt::format("{}{} ({})", text.empty() ? "" : ", ", reason, count);
  }
  return text.empty() ? "no place looks like another" : text;
}

int Merge(const MergeArguments& arguments) {
  const auto limit = LimitThreads(arguments.threads);
  if (IsSession(arguments.out))
    throw OptionError(fmt::format("--out {}: is a session of `lamina watch`", arguments.out));
  const std::vector<Drive> drives = ReadDrives(arguments);
  const LaminaConfig config = arguments.config.file.empty() && arguments.config.set.empty()
                                  ? drives.front().config
                                  : LoadConfig(arguments.config.file, arguments.config.set);
  MakeDirectory(arguments.out);
  const MergedMap merged(drives, config);
  const nlohmann::json summary = WriteMerge(arguments.out, drives, merged, config);
  WriteTextFile((std::filesystem::path(arguments.out) / "summary.json").string(),
                SummaryText(summary));
  fmt::print("{} {}, {} submaps, {} loops accepted between them: {}\n", drives.size(),
             drives.size() == 1 ? "drive" : "drives", merged.graph().poses.size(),
             summary["loops"]["accepted"].dump(),
             merged.frames() == 1 ? "one map"
                                  : fmt::format("{} maps that nothing connects", merged.frames()));
  const std::filesystem::path out(arguments.out);
  if (merged.frames() > 1) {
    fmt::print("refused      {}; each is in {}\n",
               DescribeRefusals(summary["loops"]["refused_by_reason"]),
               (out / "loops.csv").string());
  }
  fmt::print("trajectories {}, and one for each drive: {} ...\nmap          {}\nfigures      {}\n",
             (out / "trajectory_tum.txt").string(), DriveTrajectoryName(0),
             (out / MapFileName(0)).string(), (out / "summary.json").string());
  return 0;
}

}  // namespace

void AddMergeCommand(CLI::App* app, std::function<int()>* run) {
  auto arguments = std::make_shared<MergeArguments>();
  CLI::App* command =
      app->add_subcommand("merge", "Make one map of drives of one place, without initial poses");
  command
      ->add_option("drives", arguments->drives,
                   "Folders that `lamina run --loops on` wrote to; their order does not matter")
      ->required();
  command->add_option("--out", arguments->out, "Folder for the results; made if it is not there")
      ->required();
  AddConfigOptions(command, "; that of the oldest drive if left out", &arguments->config);
  AddThreadsOption(command, "", &arguments->threads);
  command->callback([arguments, run] { *run = [arguments] { return Merge(*arguments); }; });
}

}  // namespace lamina
