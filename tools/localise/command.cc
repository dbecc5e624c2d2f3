#include "tools/localise/command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <exception>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "core/base/error.h"
#include "tools/cli/common.h"
#include "tools/cli/options.h"
#include "tools/cli/progress.h"
#include "tools/commands.h"
#include "tools/localise/cases.h"
#include "tools/localise/report.h"
#include "tools/localise/trial.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

struct LocaliseArguments {
  std::string out, progress = "auto";
  std::vector<std::string> only;
  int seeds = 5, first_seed = 1, jobs = 0;
  LocalisationTrialOptions trial;
};

std::vector<LocalisationCase> Chosen(const LocaliseArguments& arguments) {
  const std::vector<LocalisationCase>& all = LocalisationCases();
  if (arguments.only.empty()) return all;
  std::vector<std::string> names;
  for (const LocalisationCase& place : all) names.push_back(place.name);
  std::vector<LocalisationCase> chosen;
  for (const std::string& name : arguments.only)
    chosen.push_back(all[PlaceOf("--only", name, names)]);
  return chosen;
}

// Each map on a thread of its own; results in the order of cases and seeds.
std::vector<LocalisationTrial> RunTrials(const LocaliseArguments& arguments, std::size_t jobs,
                                         const std::atomic<bool>& stop) {
  const std::vector<LocalisationCase> cases = Chosen(arguments);
  const auto seeds = static_cast<std::size_t>(arguments.seeds);
  std::vector<LocalisationTrial> trials(cases.size() * seeds);
  RunProgress progress(ProgressMode(arguments.progress), trials.size(), "maps");
  std::atomic<std::size_t> next{0};
  std::mutex mutex;
  std::exception_ptr error;
  const auto work = [&] {
    for (std::size_t k = next++; k < trials.size() && !stop; k = next++) {
      try {
        const int seed = arguments.first_seed + static_cast<int>(k % seeds);
        LocalisationTrial trial = RunLocalisationTrial(cases[k / seeds], seed, arguments.trial);
        const std::lock_guard<std::mutex> lock(mutex);
        trials[k] = std::move(trial);
        if (const std::size_t wrong = WrongClaims({trials[k]}); wrong > 0)
          progress.Warn(fmt::format("{}, seed {}: {} wrong", trials[k].name, seed, wrong));
        progress.Step();
      } catch (...) {
        const std::lock_guard<std::mutex> lock(mutex);
        if (!error) error = std::current_exception();
        next = trials.size();
      }
    }
  };
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < jobs; ++i) threads.emplace_back(work);
  for (std::thread& thread : threads) thread.join();
  progress.Finish();
  if (error) std::rethrow_exception(error);
  if (stop) throw InterruptedError("before all maps were done");
  return trials;
}

int RunLocalise(const LocaliseArguments& arguments) {
  if (arguments.seeds < 1)
    throw OptionError(fmt::format("--seeds = {}: must be at least 1", arguments.seeds));
  if (arguments.jobs < 0)
    throw OptionError(fmt::format("--jobs = {}: must be 0 or more", arguments.jobs));
  MakeDirectory(arguments.out);
  const auto one_thread = LimitThreads(1);
  const std::size_t processors = std::max(1U, std::thread::hardware_concurrency());
  const auto jobs = arguments.jobs > 0 ? static_cast<std::size_t>(arguments.jobs) : processors;
  const std::vector<LocalisationTrial> trials = RunTrials(arguments, jobs, StopOnSignals());
  const std::string table = LocalisationTable(trials);
  WriteTextFile((fs::path(arguments.out) / "table.md").string(), table);
  WriteTextFile((fs::path(arguments.out) / "windows.csv").string(), WindowsCsv(trials));
  WriteTextFile((fs::path(arguments.out) / "looks.csv").string(), LooksCsv(trials));
  fmt::print("{}\ntable    {}/table.md\nwindows  {}/windows.csv\nlooks    {}/looks.csv\n", table,
             arguments.out, arguments.out, arguments.out);
  return WrongClaims(trials) == 0 ? 0 : 1;
}

}  // namespace

void AddLocaliseCommand(CLI::App* app, std::function<int()>* run) {
  const auto arguments = std::make_shared<LocaliseArguments>();
  LocaliseArguments& a = *arguments;
  CLI::App* command = app->add_subcommand("localise", PurposeOfLabCommand("localise"));
  command->add_option("--out", a.out, "folder for tables; made if it is not there")->required();
  command->add_option("--only", a.only, "names of cases, a,b,c; all if left out")->delimiter(',');
  command->add_option("--seeds", a.seeds, "maps of each case")->capture_default_str();
  command->add_option("--first-seed", a.first_seed, "the first of them")->capture_default_str();
  command->add_option("--windows", a.trial.on_map, "windows on each map")->capture_default_str();
  command->add_option("--off-map", a.trial.off_map, "of the same scene, where the map is not")
      ->capture_default_str();
  command->add_option("--elsewhere", a.trial.elsewhere, "of another scene of the kind")
      ->capture_default_str();
  command->add_option("--window-s", a.trial.window_s, "how long each lasts at most")
      ->capture_default_str();
  command->add_option("--set", a.trial.set,
                      "key=value of the configuration, for all; may be given repeatedly");
  command->add_flag("--lost", a.trial.lost,
                    "lose the sensor while it maps, for half a minute before each window");
  command->add_option("--jobs", a.jobs, "maps at once; 0: as many as there are processors")
      ->capture_default_str();
  AddProgressOption(command, &a.progress);
  command->callback([arguments, run] { *run = [arguments] { return RunLocalise(*arguments); }; });
}

}  // namespace lamina
