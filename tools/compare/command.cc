#include "tools/compare/command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "core/base/error.h"
#include "io/map/trajectory_io.h"
#include "tools/cli/common.h"
#include "tools/cli/options.h"
#include "tools/commands.h"
#include "tools/compare/jobs/jobs.h"
#include "tools/compare/jobs/task.h"
#include "tools/compare/suite.h"

namespace lamina {
namespace {

struct CompareArguments {
  std::string scans, truth, reference, suite, data, out, worker;
  std::string methods = "all", initial, progress = "auto";
  std::string heat_maps = "f2m_gicp,huang,condensed";
  ConfigArguments config;
  bool quick = false, keep_data = false, resolution_study = false;
  double time_limit_s = 240.0, noise_deg = 1.0, noise_m = 0.05;
  int seed = 1, jobs = 0;
};

// Without --config: a scanner that stands still, indoors and out, with initial poses that may be
// off by some decimetres. Small leaves for furniture and steps; thin planes, or the two faces of an
// inner wall are taken for one in coarse voxels.
const std::vector<std::string>& DefaultSettings() {
  static const std::vector<std::string> settings = {"preparation.min_range_m=0.3",
                                                    "preparation.max_range_m=30",
                                                    "preparation.deskew=off",
                                                    "map.root_size_m=1",
                                                    "map.depth=3",
                                                    "map.max_thickness_m=0.025",
                                                    "registration.coarse_root_size_m=3",
                                                    "registration.rounds=5"};
  return settings;
}

CompareConfig Configuration(const CompareArguments& arguments) {
  std::vector<std::string> pairs;
  if (arguments.config.file.empty()) pairs = DefaultSettings();
  pairs.insert(pairs.end(), arguments.config.set.begin(), arguments.config.set.end());
  return LoadCompareConfig(arguments.config.file, pairs);
}

CompareSettings Settings(const CompareArguments& arguments) {
  CompareSettings settings;
  settings.methods = ParseMethods(arguments.methods);
  settings.config = Configuration(arguments);
  settings.out = arguments.out;
  settings.noise_rotation_deg = arguments.noise_deg;
  settings.noise_translation_m = arguments.noise_m;
  settings.seed = arguments.seed;
  settings.time_limit_s = arguments.time_limit_s;
  settings.at_once = static_cast<std::size_t>(arguments.jobs);
  if (arguments.jobs == 0) settings.at_once = std::max(1U, std::thread::hardware_concurrency());
  if (arguments.heat_maps != "none") settings.heat_maps = ParseMethods(arguments.heat_maps);
  settings.progress = ProgressMode(arguments.progress);
  using Initial = CompareSettings::Initial;
  const std::string initial = !arguments.initial.empty() ? arguments.initial
                              : arguments.suite.empty()  ? "teaser"
                                                         : "truth+noise";
  if (initial == "teaser") {
    settings.initial_kind = Initial::kTeaser;
  } else if (initial == "truth+noise") {
    settings.initial_kind = Initial::kNoisyTruth;
  } else {
    settings.initial_kind = Initial::kFile;
    for (const StampedPose& pose : ReadTrajectory(initial)) {
      settings.initial.push_back(pose.T_world_lidar);
    }
  }
  return settings;
}

std::vector<CompareSequence> Sequences(const CompareArguments& a, CompareSettings* settings) {
  const int sources = !a.scans.empty() + !a.suite.empty() + !a.data.empty();
  if (sources != 1) throw OptionError("give one of --scans, --suite and --data");
  const bool one_recording = !a.scans.empty();
  if (one_recording && a.truth.empty()) throw OptionError("--scans needs --truth");
  if (!settings->initial.empty() && !one_recording) {
    throw OptionError("--initial with a file goes with --scans");
  }
  if (!a.data.empty()) return EthzSequences(a.data, settings->config);
  if (!a.suite.empty()) {
    const auto folder = std::filesystem::path(a.out) / "data";
    return EthzLikeSequences(folder.string(), a.seed, a.quick, a.keep_data);
  }
  CompareSequence sequence =
      OpenSequence("sequence", a.scans, a.truth, a.reference, settings->config);
  if (!settings->initial.empty() && settings->initial.size() != sequence.truth.size()) {
    throw InputError(fmt::format("{}: holds {} poses for {} scans; one for each scan is needed",
                                 a.initial, settings->initial.size(), sequence.truth.size()));
  }
  return {sequence};
}

std::string Title(const CompareArguments& a, std::size_t sequences) {
  if (!a.data.empty()) return fmt::format("ETHZ data set, {} sequences", sequences);
  if (a.suite.empty()) return a.scans;
  return fmt::format("Synthetic scenes like those of the ETHZ data set{}, seed {}",
                     a.quick ? " (quick form)" : "", a.seed);
}

void WriteTables(const std::string& out, const CompareTable& table) {
  const std::filesystem::path folder(out);
  const std::string markdown = MarkdownTable(table);
  WriteTextFile((folder / "table.md").string(), markdown);
  WriteTextFile((folder / "table.csv").string(), CsvTable(table));
  WriteTextFile((folder / "table.json").string(), JsonTable(table).dump(2) + "\n");
  DrawStructuralErrors((folder / "structural_error.png").string(), table);
  fmt::print("{}\n", markdown);
}

void WriteStudy(const std::string& out, const std::vector<ResolutionPoint>& points) {
  const std::filesystem::path folder(out);
  std::string csv = "curve,resolution_m,ape_cm,solve_ms,planes,iterations\n";
  for (const ResolutionPoint& p : points) {
    csv += fmt::format("\"{}\",{:g},{:.4f},{:.3f},{},{}\n", p.curve, p.resolution_m, p.ape_cm,
                       p.solve_ms, p.planes, p.iterations);
  }
  WriteTextFile((folder / "resolution.csv").string(), csv);
  if (!points.empty()) DrawResolutionStudy((folder / "resolution.png").string(), points);
}

int Compare(const CompareArguments& arguments) {
  if (!arguments.worker.empty()) return RunCompareWorker(arguments.worker);
  if (arguments.out.empty()) throw OptionError("--out is required");
  CompareSettings settings = Settings(arguments);
  const std::vector<CompareSequence> sequences = Sequences(arguments, &settings);
  Comparison comparison(settings, StopOnSignals());
  CompareTable table;
  table.title = Title(arguments, sequences.size());
  table.methods = settings.methods;
  for (const CompareSequence& sequence : sequences) {
    table.columns.push_back(comparison.Run(sequence));
    WriteTables(arguments.out, table);
  }
  if (arguments.resolution_study) {
    // A place with surfaces of all sizes, if the suite has it.
    const auto hall =
        std::find_if(sequences.begin(), sequences.end(),
                     [](const CompareSequence& s) { return s.name == "hauptgebaeude"; });
    const CompareSequence& sequence = hall == sequences.end() ? sequences.front() : *hall;
    WriteStudy(arguments.out, comparison.StudyResolution(sequence, {0.05, 0.1, 0.2, 0.4}));
  }
  fmt::print("tables {0}/table.md, {0}/table.csv, {0}/table.json; pictures {0}/*.png\n",
             arguments.out);
  return 0;
}

void AddOptions(CLI::App* command, CompareArguments* a) {
  command->add_option("--scans", a->scans, "Recording, as for `lamina run`");
  command->add_option("--truth", a->truth,
                      "With --scans: true poses, one for each scan (KITTI, TUM, or "
                      "pose_scanner_leica.csv)");
  command->add_option(
      "--reference", a->reference,
      "With --scans: cloud of the true surfaces in the frame of the true poses, for "
      "structural errors");
  command->add_option("--suite", a->suite, "Eight synthetic scenes, made for the purpose")
      ->check(CLI::IsMember({"ethz-like"}));
  command->add_flag("--quick", a->quick, "With --suite: two scenes of few and coarse scans");
  command->add_option("--data", a->data, "Folder of the ETHZ data set");
  command->add_option("--out", a->out, "Folder for rows, tables and pictures; made if need be");
  command
      ->add_option("--methods", a->methods,
                   "all, or names parted by commas; a name of a local method without f2f_ or f2m_ "
                   "is both")
      ->capture_default_str();
  command->add_option("--initial", a->initial,
                      "Initial poses of methods that need some: a file, teaser (its synchronised "
                      "poses), or truth+noise; left out, truth+noise with --suite, else teaser");
  command->add_option("--noise-deg", a->noise_deg, "truth+noise: standard deviation of turns")
      ->check(CLI::Range(0.0, 180.0))
      ->capture_default_str();
  command->add_option("--noise-m", a->noise_m, "truth+noise: standard deviation of positions")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  command->add_option("--seed", a->seed, "Of scenes and noise")
      ->check(CLI::Range(0, 2147483647))
      ->capture_default_str();
  command
      ->add_option(
          "--time-limit", a->time_limit_s,
          "Seconds of processor time that a job may take: a method, with what it builds on; four "
          "times as much on the wall")
      ->check(CLI::Range(0.01, 1e6))
      ->capture_default_str();
  command
      ->add_option("--jobs", a->jobs,
                   "Jobs at once, each on one thread; 0: as many as there are cores")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  command
      ->add_option("--heat-maps", a->heat_maps,
                   "Methods whose maps are written and drawn in colours of their error; none for "
                   "none")
      ->capture_default_str();
  command->add_flag("--resolution-study", a->resolution_study,
                    "Error and solve time against the resolution of the input, too");
  command->add_flag("--keep-data", a->keep_data,
                    "With --suite: do not remove its scans at the end");
  AddTopicOption(command, &a->config);
  AddConfigOptions(command, "; without it settings for a scanner that stands still are taken",
                   &a->config);
  AddProgressOption(command, &a->progress);
  // A job of a comparison: see tools/compare/jobs/jobs.h.
  command->add_option(kWorkerOption, a->worker)->group("");
}

}  // namespace

void AddCompareCommand(CLI::App* app, std::function<int()>* run) {
  auto arguments = std::make_shared<CompareArguments>();
  CLI::App* command = app->add_subcommand("compare", PurposeOfLabCommand("compare"));
  AddOptions(command, arguments.get());
  command->callback([arguments, run] { *run = [arguments] { return Compare(*arguments); }; });
}

}  // namespace lamina
