#include "tools/campaign/command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <exception>
#include <memory>

#include "core/base/printable_text.h"
#include "tools/campaign/campaign.h"
#include "tools/campaign/together.h"
#include "tools/cli/options.h"

namespace lamina {
namespace {

int RunOnRanks(const CampaignArguments& arguments) {
  const Ranks ranks;
  try {
    return RunCampaign(arguments, ranks);
  } catch (const EndedTogether& ended) {
    if (ended.error != nullptr) std::rethrow_exception(ended.error);
    return 0;
  } catch (const std::exception& error) {
    if (ranks.size() == 1) throw;
    // The others wait for this rank.
    fmt::print(stderr, "lamina: error: rank {}: {}\n", ranks.rank(), Printable(error.what()));
    ranks.Abort(1);
  }
}

}  // namespace

void AddCampaignCommand(CLI::App* app, std::function<int()>* run) {
  auto arguments = std::make_shared<CampaignArguments>();
  CLI::App* command = app->add_subcommand(
      "campaign", "Map many recordings of one place and join them, over many processes (mpirun)");
  command
      ->add_option("--recordings", arguments->recordings,
                   "YAML list: `recordings:` with a path or pattern each, or scans, name, frames "
                   "and topic")
      ->required();
  command
      ->add_option("--out", arguments->out,
                   "Folder for the results, seen by all processes; what is in it already, of the "
                   "same scans and options, is kept")
      ->required();
  command
      ->add_option("--level", arguments->level,
                   "What the last bundle adjustment moves: `submaps`, each as a whole, or all "
                   "`keyframes`; more exact, and takes longer")
      ->check(CLI::IsMember({"submaps", "keyframes"}))
      ->capture_default_str();
  KeyframeBundleOptions& keyframes = arguments->keyframes;
  command->add_option("--keyframe-rounds", keyframes.rounds, "Its rounds of association at most")
      ->check(CLI::Range(1, 100))
      ->capture_default_str();
  command
      ->add_option("--tile-size", keyframes.tile_size_m,
                   "Edge of the tiles of space that it holds in memory, some at once, metres")
      ->check(CLI::Range(1.0, 10000.0))
      ->capture_default_str();
  command
      ->add_option("--plane-observations", keyframes.most_observations,
                   "Keyframes that see one plane and take part one by one; more are summed with "
                   "their neighbours in time; 0: any number")
      ->check(CLI::Range(0, 1000000))
      ->capture_default_str();
  command->add_option("--scratch", arguments->scratch,
                      "Folder on a disk of the machine for files that outgrow memory; else --out");
  AddConfigOptions(command, "; one for all recordings", &arguments->config);
  AddThreadsOption(command, " in each process", &arguments->threads);
  command->footer(
      "`mpirun -n 4 lamina campaign ...` shares the work out over 4 processes, on one machine or\n"
      "many; the results are the same at any number. A campaign that was ended is started again\n"
      "by the same command, and goes on.");
  command->callback([arguments, run] { *run = [arguments] { return RunOnRanks(*arguments); }; });
}

}  // namespace lamina
