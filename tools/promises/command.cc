#include "tools/promises/command.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <exception>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "core/base/error.h"
#include "tools/cli/common.h"
#include "tools/cli/options.h"
#include "tools/commands.h"
#include "tools/promises/promises.h"
#include "tools/promises/random_rows.h"
#include "tools/promises/report.h"
#include "tools/promises/trial.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

struct AdverseArguments {
  std::string promises = "tools/promises/promises.md", out, progress = "auto";
  std::vector<std::string> only, set;
  int first_seed = 1, jobs = 0;
  std::optional<int> seeds;
  int random = 0, random_seed = 1;  // 0: rows are read, not drawn
  std::string places = "all";

  int Seeds() const { return seeds.value_or(random > 0 ? 1 : 20); }
};

std::vector<Promise> PromisesOf(const AdverseArguments& arguments) {
  if (arguments.random == 0) return ReadPromises(arguments.promises);
  return DrawPromises(arguments.random, arguments.random_seed,
                      ByName<RandomPlaces>("--places", arguments.places, RandomPlacesNames()));
}

// Those named, in the order of the table; all if none is.
std::vector<Promise> Chosen(const AdverseArguments& arguments) {
  std::vector<Promise> promises = PromisesOf(arguments);
  if (arguments.only.empty()) return promises;
  std::vector<std::string> names;
  for (const Promise& promise : promises) names.push_back(promise.name);
  for (const std::string& name : arguments.only) PlaceOf("--only", name, names);
  const auto is_left_out = [&](const Promise& promise) {
    return std::find(arguments.only.begin(), arguments.only.end(), promise.name) ==
           arguments.only.end();
  };
  promises.erase(std::remove_if(promises.begin(), promises.end(), is_left_out), promises.end());
  return promises;
}

// All trials, each on a thread of its own, and their results in the order of promises and seeds.
class Trials {
 public:
  Trials(const AdverseArguments& arguments, std::vector<Promise> promises)
      : arguments_(arguments),
        promises_(std::move(promises)),
        seeds_(static_cast<std::size_t>(arguments.Seeds())),
        progress_(ProgressMode(arguments.progress), promises_.size() * seeds_, "trials") {
    for (const Promise& promise : promises_) {
      results_.push_back({promise, std::vector<SeedResult>(seeds_)});
    }
  }

  std::vector<PromiseResults> Run(std::size_t jobs, const std::atomic<bool>& stop) {
    std::vector<std::thread> threads;
    for (std::size_t i = 0; i < jobs; ++i) threads.emplace_back([&] { Work(stop); });
    for (std::thread& thread : threads) thread.join();
    progress_.Finish();
    if (error_) std::rethrow_exception(error_);
    if (stop) throw InterruptedError("before all trials were done");
    return std::move(results_);
  }

 private:
  void Work(const std::atomic<bool>& stop) {
    while (!stop) {
      const std::size_t k = next_++;
      if (k >= promises_.size() * seeds_) return;
      try {
        RunOne(k);
      } catch (...) {
        const std::lock_guard<std::mutex> lock(mutex_);
        if (!error_) error_ = std::current_exception();
        next_ = promises_.size() * seeds_;
      }
    }
  }

  void RunOne(std::size_t k) {
    const Promise& promise = promises_[k / seeds_];
    const int seed = arguments_.first_seed + static_cast<int>(k % seeds_);
    const Trial trial = MapTrial(promise, seed, arguments_.set);
    SeedResult result{seed, JudgeTrial(trial.frames, promise), CheckCovariance(trial.frames),
                      trial.cpu_s, trial.frames.size()};
    const fs::path path =
        fs::path(arguments_.out) / "frames" / fmt::format("{}_{}.csv", promise.name, seed);
    WriteTextFile(path.string(), FramesCsv(trial.frames, result.verdict));
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!result.verdict.kept) {
      progress_.Warn(fmt::format("{}, seed {}: {}", promise.name, seed, result.verdict.broken));
    }
    results_[k / seeds_].trials[k % seeds_] = std::move(result);
    progress_.Step();
  }

  const AdverseArguments& arguments_;
  std::vector<Promise> promises_;
  std::size_t seeds_;
  std::atomic<std::size_t> next_{0};
  std::mutex mutex_;  // all below
  RunProgress progress_;
  std::vector<PromiseResults> results_;
  std::exception_ptr error_;
};

int RunAdverse(const AdverseArguments& arguments) {
  if (arguments.Seeds() < 1)
    throw OptionError(fmt::format("--seeds = {}: must be at least 1", arguments.Seeds()));
  if (arguments.random < 0)
    throw OptionError(fmt::format("--random = {}: must be 0 or more", arguments.random));
  if (arguments.jobs < 0)
    throw OptionError(fmt::format("--jobs = {}: must be 0 or more", arguments.jobs));
  std::vector<Promise> promises = Chosen(arguments);
  for (const Promise& promise : promises) CheckTrial(promise, arguments.set);
  MakeDirectory(arguments.out);
  MakeDirectory((fs::path(arguments.out) / "frames").string());
  if (arguments.random > 0) {
    WriteTextFile((fs::path(arguments.out) / "promises.md").string(), FormatPromises(promises));
  }
  // One thread a trial: processor time compares, and the result is the same at any number.
  const auto one_thread = LimitThreads(1);
  const std::size_t processors = std::max(1U, std::thread::hardware_concurrency());
  const auto jobs = arguments.jobs > 0 ? static_cast<std::size_t>(arguments.jobs) : processors;
  const std::vector<PromiseResults> results =
      Trials(arguments, std::move(promises)).Run(jobs, StopOnSignals());
  const std::string table = PromiseTable(results);
  WriteTextFile((fs::path(arguments.out) / "table.md").string(), table);
  WriteTextFile((fs::path(arguments.out) / "trials.csv").string(), TrialsCsv(results));
  fmt::print("{}\ntable   {}/table.md\ntrials  {}/trials.csv\nframes  {}/frames\n", table,
             arguments.out, arguments.out, arguments.out);
  const auto is_kept = [](const PromiseResults& r) { return r.kept() == r.trials.size(); };
  return std::all_of(results.begin(), results.end(), is_kept) ? 0 : 1;
}

}  // namespace

void AddAdverseCommand(CLI::App* app, std::function<int()>* run) {
  const auto arguments = std::make_shared<AdverseArguments>();
  AdverseArguments& a = *arguments;
  CLI::App* command = app->add_subcommand("adverse", PurposeOfLabCommand("adverse"));
  command->add_option("--out", a.out, "folder for tables; made if it is not there")->required();
  CLI::Option* promises =
      command->add_option("--promises", a.promises, "table of promises; says what its columns mean")
          ->capture_default_str();
  command
      ->add_option("--random", a.random,
                   "so many scenes drawn at random, instead of a table; --out keeps the table of "
                   "them as promises.md")
      ->excludes(promises);
  command->add_option("--random-seed", a.random_seed, "for other scenes drawn at random")
      ->capture_default_str();
  command
      ->add_option("--places", a.places,
                   fmt::format("random: where; {}", fmt::join(RandomPlacesNames(), ", ")))
      ->capture_default_str();
  command->add_option("--seeds", a.seeds,
                      "seeds of each scene; if left out 20, of scenes drawn at random 1");
  command->add_option("--first-seed", a.first_seed, "the first of them")->capture_default_str();
  command->add_option("--only", a.only, "names of promises, a,b,c; all if left out")
      ->delimiter(',');
  command->add_option("--set", a.set,
                      "key=value of the configuration, for all trials; may be given repeatedly");
  command->add_option("--jobs", a.jobs, "trials at once; 0: as many as there are processors")
      ->capture_default_str();
  AddProgressOption(command, &a.progress);
  command->callback([arguments, run] { *run = [arguments] { return RunAdverse(*arguments); }; });
}

}  // namespace lamina
