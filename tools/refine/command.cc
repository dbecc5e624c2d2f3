#include "tools/refine/command.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "io/file/checksum.h"
#include "io/file/folder_writer.h"
#include "io/file/text_input.h"
#include "tools/cli/common.h"
#include "tools/cli/options.h"
#include "tools/merge/drive.h"
#include "tools/merge/merge_results.h"
#include "tools/merge/merged_map.h"
#include "tools/refine/journal.h"
#include "tools/results/output_folder.h"
#include "tools/results/submap_file.h"
#include "tools/results/verdict/process_report.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

struct RefineArguments {
  std::string session, out;
  ConfigArguments config;
  int threads = 0;
};

// Results appear there whole, so nothing may be there before.
void CheckOut(const RefineArguments& arguments) {
  std::error_code ignored;
  if (!fs::exists(arguments.out, ignored)) return;
  if (fs::is_directory(arguments.out, ignored) && fs::is_empty(arguments.out, ignored)) return;
  throw OptionError(
      fmt::format("--out {}: is there already; results are written to a new folder, whole or not "
                  "at all",
                  arguments.out));
}

// Of what results follow from.
std::uint32_t MadeOf(const std::string& session, const LaminaConfig& config) {
  const std::string submaps = ReadFile((fs::path(session) / kSubmapFileName).string());
  return Crc32(ResultOptionsToYaml(config), Crc32(submaps));
}

int Refine(const RefineArguments& arguments) {
  const auto limit = LimitThreads(arguments.threads);
  CheckOut(arguments);
  std::vector<Drive> drives = {ReadDrive(arguments.session)};
  SortByAge(&drives);
  const LaminaConfig config = arguments.config.file.empty() && arguments.config.set.empty()
                                  ? drives.front().config
                                  : LoadConfig(arguments.config.file, arguments.config.set);
  // A name that ends in a slash has no last part.
  fs::path out = fs::absolute(arguments.out).lexically_normal();
  if (!out.has_filename()) out = out.parent_path();
  FolderWriter folder(out, out.string() + ".partial");
  JournalFile journal(out.string() + ".progress", MadeOf(arguments.session, config));
  if (journal.found() > 0)
    spdlog::info("going on with {} results of an earlier call", journal.found());
  MergedMap::Work work;
  work.on_pairs = [](std::size_t done, std::size_t due) {
    spdlog::info("compared {} of {} pairs of submaps", done, due);
  };
  work.bundle.on_round = [](int round, double move_m) {
    spdlog::info("adjusted anchors, round {}: {:.3f} m at most", round, move_m);
  };
  work.bundle.journal = &journal;
  const MergedMap refined(drives, config, MergedMap::Effort::kAllPairs, work);
  const nlohmann::json summary = WriteMerge(folder.path(), drives, refined, config);
  WriteTextFile((fs::path(folder.path()) / "summary.json").string(), SummaryText(summary));
  folder.Commit();
  journal.Remove();
  fmt::print(
      "{} submaps, {} loops accepted that were not known; anchors adjusted in {} rounds by {} "
      "planes, {:.3f} m at most\n",
      refined.graph().poses.size(), summary["loops"]["accepted"].dump(), refined.bundle().rounds,
      refined.bundle().planes, refined.bundle().largest_move_m);
  fmt::print("trajectory  {}\nmap         {}\nfigures     {}\n",
             (out / "trajectory_tum.txt").string(), (out / MapFileName(0)).string(),
             (out / "summary.json").string());
  return 0;
}

}  // namespace

void AddRefineCommand(CLI::App* app, std::function<int()>* run) {
  auto arguments = std::make_shared<RefineArguments>();
  CLI::App* command = app->add_subcommand(
      "refine", "Bring the map of a run with loops to agree with itself, by all that overlaps");
  command
      ->add_option("--session,--run", arguments->session,
                   "Folder with submaps.bin: of `lamina run --loops on`, of a session of `lamina "
                   "watch` with loops.enabled that has ended, or of `lamina merge`")
      ->required();
  command
      ->add_option("--out", arguments->out,
                   "Folder for the results, which must not be there; it appears when all is done. "
                   "What is done until then is in OUT.progress: after an interruption the same "
                   "command goes on with it")
      ->required();
  AddConfigOptions(command, "; that of the session if left out", &arguments->config);
  AddThreadsOption(command, "", &arguments->threads);
  command->callback([arguments, run] { *run = [arguments] { return Refine(*arguments); }; });
}

}  // namespace lamina
