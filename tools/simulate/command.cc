#include "tools/simulate/command.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "io/file/file_writer.h"
#include "tools/cli/common.h"
#include "tools/cli/options.h"
#include "tools/cli/progress.h"
#include "tools/commands.h"
#include "tools/simulate/nees.h"
#include "tools/simulate/plot.h"
#include "tools/simulate/report.h"
#include "tools/simulate/study.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// What the command line gives; choices and lists as typed.
struct SimulateArguments {
  std::optional<std::string> formulations, sweep, values;
  std::string generator = "ferrer", out, progress = "auto";
  std::int64_t seed = 1;
  int threads = 0;
  bool nees = false;
  StudyOptions study;  // the rest
};

std::vector<std::string> Split(const std::string& list) {
  std::vector<std::string> items;
  std::size_t begin = 0;
  for (std::size_t comma = 0; comma != std::string::npos; begin = comma + 1) {
    comma = list.find(',', begin);
    items.push_back(list.substr(begin, comma == std::string::npos ? comma : comma - begin));
  }
  return items;
}

std::vector<const Formulation*> ParseFormulations(const std::string& list) {
  std::vector<const Formulation*> formulations;
  for (const std::string& name : Split(list)) {
    const Formulation* const f =
        Formulations()[PlaceOf("--formulations", name, FormulationNames())];
    if (std::find(formulations.begin(), formulations.end(), f) != formulations.end()) {
      throw OptionError(fmt::format("--formulations = '{}': names {} twice", list, name));
    }
    formulations.push_back(f);
  }
  return formulations;
}

std::vector<double> ParseValues(const std::string& list) {
  std::vector<double> values;
  for (const std::string& text : Split(list)) {
    double value = 0.0;
    const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || rest != text.data() + text.size() || !std::isfinite(value)) {
      throw OptionError(fmt::format("--values = '{}': '{}' is not a number", list, text));
    }
    if (std::find(values.begin(), values.end(), value) != values.end()) {
      throw OptionError(fmt::format("--values = '{}': names {} twice", list, value));
    }
    values.push_back(value);
  }
  return values;
}

// No sweep named: those of figure 1 of the paper; for NEES, the base values alone.
std::vector<Sweep> ChooseSweeps(const SimulateArguments& a) {
  if (a.sweep) {
    const auto kind = ByName<SweepKind>("--sweep", *a.sweep, SweepNames());
    return {{kind, a.values ? ParseValues(*a.values) : DefaultValues(kind)}};
  }
  if (a.values) throw OptionError("--values: are those of --sweep, which is missing");
  if (a.nees) return {{SweepKind::kNoise, {a.study.base.noise_m}}};
  std::vector<Sweep> sweeps;
  for (const SweepKind kind : {SweepKind::kPlanes, SweepKind::kPoses, SweepKind::kNoise}) {
    sweeps.push_back({kind, DefaultValues(kind)});
  }
  return sweeps;
}

StudyOptions CheckedStudy(const SimulateArguments& a) {
  StudyOptions study = a.study;
  study.base.generator = ByName<SceneGenerator>("--generator", a.generator, SceneGeneratorNames());
  if (a.nees && a.formulations.value_or("condensed") != "condensed") {
    throw OptionError(fmt::format(
        "--formulations = '{}': --nees is the covariance of condensed alone", *a.formulations));
  }
  const std::string all = fmt::format("{}", fmt::join(FormulationNames(), ","));
  study.formulations = ParseFormulations(a.formulations.value_or(all));
  study.sweeps = ChooseSweeps(a);
  if (a.seed < 0) {
    throw OptionError(fmt::format("--seed = {}: must be in [0, {}]", a.seed, kLargestSeed));
  }
  study.seed = static_cast<std::uint64_t>(a.seed);
  study.Check();
  if (a.nees) CheckNeesStudy(study);
  return study;
}

// The folder of the results.
class Output {
 public:
  explicit Output(const std::string& folder) : folder_(folder) { MakeDirectory(folder); }
  std::string Path(const char* name) const { return (folder_ / name).string(); }
  void Write(const char* name, const std::string& text) const { WriteTextFile(Path(name), text); }

 private:
  fs::path folder_;
};

// Whether all was done.
bool SayIfStopped(std::size_t done, std::size_t all) {
  if (done < all) fmt::print("stopped after {} of {} scenes; these are written\n", done, all);
  return done >= all;
}

// Whether all was done.
bool RunFormulations(const StudyOptions& study, const Output& output, const std::atomic<bool>& stop,
                     RunProgress* progress) {
  TrialTable table(output.Path("trials.csv"));
  std::vector<TrialResult> results;
  const auto sink = [&](const std::vector<TrialResult>& trial) {
    table.Append(trial);
    results.insert(results.end(), trial.begin(), trial.end());
    progress->Step();
  };
  RunStudy(study, sink, &stop);
  progress->Finish();
  table.Commit();
  const std::vector<TrialSummary> summaries = SummariseTrials(results);
  const std::string tables = SummaryTables(study, summaries);
  output.Write("summary.json", SummaryJson(study, summaries).dump(2) + "\n");
  output.Write("summary.md", tables);
  fmt::print("{}\n", tables);
  const bool complete = SayIfStopped(results.size() / study.formulations.size(), study.Scenes());
  fmt::print("figures  {0}, {1}, {2}\n", output.Path("trials.csv"), output.Path("summary.json"),
             output.Path("summary.md"));
  if (summaries.empty()) return complete;
  // Hours of trials must not end as a failure for want of a picture.
  try {
    fmt::print("picture  {}\n", DrawStudy(summaries, output.Path("figure1")));
  } catch (const OutputError& error) {
    spdlog::warn("no picture, all else is written: {}", error.what());
  }
  return complete;
}

// Whether all was done.
bool RunNees(const StudyOptions& study, const Output& output, const std::atomic<bool>& stop,
             RunProgress* progress) {
  FileWriter table(output.Path("nees.csv"));
  table.Write(
      "sweep,value,trial,seed,nees,degrees_of_freedom,rot_error_deg,trans_error_m,status\n");
  std::vector<NeesTrial> trials;
  const auto sink = [&](const NeesTrial& t) {
    table.Write(fmt::format("{},{},{},{},{:.9g},{},{:.9g},{:.9g},{}\n",
                            SweepNames().at(static_cast<std::size_t>(t.sweep)), t.value, t.trial,
                            t.seed, t.nees, t.degrees_of_freedom, t.errors.rot_deg,
                            t.errors.trans_m, StatusName(t.status)));
    trials.push_back(t);
    progress->Step();
  };
  RunNeesStudy(study, sink, &stop);
  progress->Finish();
  table.Commit();
  for (const NeesSummary& summary : SummariseNees(trials)) {
    fmt::print("{}", DescribeNees(summary));
  }
  const bool complete = SayIfStopped(trials.size(), study.Scenes());
  fmt::print("figures  {}\n", output.Path("nees.csv"));
  return complete;
}

int RunSimulate(const SimulateArguments& arguments) {
  const StudyOptions study = CheckedStudy(arguments);
  const auto limit = LimitThreads(arguments.threads);
  const Output output(arguments.out);
  RunProgress progress(ProgressMode(arguments.progress), study.Scenes(), "scenes");
  const std::atomic<bool>& stop = StopOnSignals();
  const bool complete = arguments.nees ? RunNees(study, output, stop, &progress)
                                       : RunFormulations(study, output, stop, &progress);
  if (!complete) throw InterruptedError("what was done until then is written");
  return 0;
}

std::string DescribeSweeps() {
  std::string text = "property to vary: ";
  for (std::size_t i = 0; i < SweepNames().size(); ++i) {
    text += fmt::format("{}{} ({})", i == 0 ? "" : ", ", SweepNames()[i],
                        fmt::join(DefaultValues(static_cast<SweepKind>(i)), ","));
  }
  return text +
         ", in brackets the values if --values names none. Left out: planes, poses and noise, one "
         "after the other, as in figure 1 of Huang et al., RA-L 2021";
}

void AddStudyOptions(CLI::App* command, SimulateArguments* a) {
  command->add_option("--out", a->out, "folder for the results; made if it is not there")
      ->required();
  command->add_option("--formulations", a->formulations,
                      fmt::format("which to compare, by commas: {}; all if left out",
                                  fmt::join(FormulationNames(), ",")));
  command->add_option("--sweep", a->sweep, DescribeSweeps());
  command->add_option(
      "--values", a->values,
      fmt::format("values of --sweep, by commas: noise in m; start in degrees of rotation, "
                  "translation goes along with {} m per degree (0.5 m at 20 degrees)",
                  kStartMetresPerDegree));
  command->add_option("--trials", a->study.trials, "scenes of each value")->capture_default_str();
  command
      ->add_option("--seed", a->seed,
                   "another seed, other scenes. The seed in a row of trials.csv, with its value as "
                   "the only one, gives that scene again")
      ->capture_default_str();
  command->add_option("--max-iterations", a->study.max_iterations, "steps that a solve may try")
      ->capture_default_str();
  AddThreadsOption(command, ". Times differ, all else is the same", &a->threads);
  command->add_flag("--nees", a->nees,
                    "instead: is the covariance of condensed consistent? Mean of the normalised "
                    "estimation error squared, against its 95 % interval");
  AddProgressOption(command, &a->progress);
}

void AddSceneOptions(CLI::App* command, SimulateArguments* a) {
  SimulationOptions& o = a->study.base;
  command
      ->add_option(
          "--generator", a->generator,
          fmt::format("ferrer: poses on the geodesic to a drawn one, planes of {} m within "
                      "+-{} m; balm2: the virtual benchmark of BALM 2, poses within {} m "
                      "and {} rad, planes of {} m within +-{} m",
                      kFerrerPatchM, kFerrerCubeM, kBalm2TranslationM, kBalm2RotationRad,
                      kBalm2PatchM, kBalm2CubeM))
      ->capture_default_str();
  command->add_option("--poses", o.poses, "number of poses of a scene")->capture_default_str();
  command->add_option("--planes", o.planes, "number of planes of a scene")->capture_default_str();
  command->add_option("--points", o.points, "points of a plane in a pose that sees it")
      ->capture_default_str();
  command->add_option("--noise-m", o.noise_m, "standard deviation of points along the normal, m")
      ->capture_default_str();
  command
      ->add_option("--start-deg", o.start_deg, "rotation error of each pose's start value, degrees")
      ->capture_default_str();
  command->add_option("--start-m", o.start_m, "translation error of each pose's start value, m")
      ->capture_default_str();
  command
      ->add_option("--visibility", o.visibility,
                   "chance that a pose sees a plane; at least two poses see each")
      ->capture_default_str();
}

}  // namespace

void AddSimulateCommand(CLI::App* app, std::function<int()>* run) {
  CLI::App* command = app->add_subcommand("simulate", PurposeOfLabCommand("simulate"));
  command->footer(
      "Errors: root mean square over the poses after the first, which is held at the truth.\n"
      "Costs: the eigenvalue cost of the final poses, whatever a formulation minimises itself;\n"
      "cost_gap: its relative distance from the best that any formulation of the trial met with.\n"
      "Ctrl-C ends the study in good order with the trials so far.");
  const auto arguments = std::make_shared<SimulateArguments>();
  AddStudyOptions(command, arguments.get());
  AddSceneOptions(command, arguments.get());
  command->callback([arguments, run] { *run = [arguments] { return RunSimulate(*arguments); }; });
}

}  // namespace lamina
