#include "tools/benchmark/command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "config/config.h"
#include "core/base/error.h"
#include "io/file/file_writer.h"
#include "io/file/text_input.h"
#include "io/recording/scan_source.h"
#include "tools/benchmark/against.h"
#include "tools/benchmark/cases.h"
#include "tools/benchmark/counters.h"
#include "tools/benchmark/figures.h"
#include "tools/benchmark/floor.h"
#include "tools/benchmark/machine.h"
#include "tools/benchmark/measure.h"
#include "tools/benchmark/scaling.h"
#include "tools/cli/common.h"
#include "tools/cli/options.h"
#include "tools/cli/program_path.h"
#include "tools/commands.h"
#include "tools/plot/gnuplot.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

struct BenchArguments {
  std::string out, program, against, results;
  std::vector<std::string> cases, only;
  std::vector<int> threads{1, 2};
  int frames = 0, repetitions = 5, counted_frames = 20;
  bool count = false, scaling = false;
  ScalingOptions scaling_options;
};

constexpr std::size_t kGeneratedFrames = 100;

// A case, its scans, and a row for each number of threads.
struct CaseRuns {
  BenchCase bench_case;
  std::unique_ptr<ScanSource> source;
  double leaf_size_m = 0.0;
  std::size_t frames = 0;
  std::vector<BenchRow> rows;
};

void Say(const std::string& what) { fmt::print(stderr, "{}\n", what); }

std::string OutPath(const BenchArguments& arguments, const std::string& name) {
  return (fs::path(arguments.out) / name).string();
}

std::vector<BenchCase> ChosenCases(const BenchArguments& arguments) {
  std::vector<BenchCase> all = GeneratedCases(
      arguments.frames > 0 ? static_cast<std::size_t>(arguments.frames) : kGeneratedFrames);
  for (const std::string& text : arguments.cases) all.push_back(ParseCase(text));
  std::vector<std::string> names;
  for (const BenchCase& c : all) {
    if (std::find(names.begin(), names.end(), c.name) != names.end())
      throw OptionError(fmt::format("--case {}: there is one of this name", c.name));
    names.push_back(c.name);
  }
  if (arguments.only.empty()) return all;
  std::vector<BenchCase> chosen;
  for (const std::string& name : arguments.only)
    chosen.push_back(all[PlaceOf("--only", name, names)]);
  return chosen;
}

CaseRuns OpenCase(const BenchArguments& arguments, BenchCase bench_case) {
  CaseRuns runs;
  PrepareCase(OutPath(arguments, "scans/" + bench_case.name), &bench_case);
  const LaminaConfig config = LoadConfig(bench_case.config, bench_case.set);
  runs.source = OpenScans(bench_case.scans, config.scans);
  runs.leaf_size_m = config.map.LeafSize();
  runs.frames = runs.source->size();
  if (arguments.frames > 0)
    runs.frames = std::min(runs.frames, static_cast<std::size_t>(arguments.frames));
  if (runs.frames == 0) throw InputError(bench_case.scans + ": has no scans");
  for (const int threads : arguments.threads)
    runs.rows.push_back({bench_case.name, threads, runs.frames, 0.0, {}});
  runs.bench_case = std::move(bench_case);
  return runs;
}

// The floor, and a run at each number of threads; every figure gets one more value.
void Repeat(const std::string& lamina, const std::string& out, CaseRuns* runs) {
  const Floor floor = MeasureFloor(*runs->source, runs->frames, runs->leaf_size_m);
  for (BenchRow& row : runs->rows) {
    const MeasuredRun run = MeasureRun(lamina, runs->bench_case, row.threads, runs->frames, out);
    row.points_a_frame = floor.points;
    AddRun(run, &row);
    row.Add("floor_ms", "ms", floor.cpu_ms);
    if (const BenchFigure* const cpu = row.Find("cpu_ms"); cpu != nullptr)
      row.Add("over_floor", "", cpu->runs.back() / floor.cpu_ms);
    // A scan alone, until its results are written: no less than the time to the first pose.
    const MeasuredRun first = MeasureRun(lamina, runs->bench_case, row.threads, 1, out);
    row.Add("first_scan_ms", "ms", 1e3 * first.usage.wall_s);
  }
}

// Of a frame: what the second half of so many frames takes beyond the first half, without start
// and end of the program.
void Count(const BenchArguments& arguments, EventCounter counter, CaseRuns* runs) {
  const std::size_t all =
      std::min(runs->frames, static_cast<std::size_t>(arguments.counted_frames));
  const std::size_t half = all / 2;
  if (half == 0) return;
  const auto count = [&](std::size_t frames) {
    return CountEvents(
        counter,
        RunCommandLine(arguments.program, runs->bench_case, 1, frames, OutPath(arguments, "run")),
        arguments.out);
  };
  const EventCounts first = count(half), both = count(all);
  const double n = static_cast<double>(all - half);
  const bool exact = counter == EventCounter::kCallgrind;
  BenchRow& row = runs->rows.front();
  row.Add("instructions", "million", 1e-6 * (both.instructions - first.instructions) / n, exact);
  row.Add("cache_misses", "thousand", 1e-3 * (both.cache_misses - first.cache_misses) / n, exact);
}

void CountAll(const BenchArguments& arguments, std::vector<CaseRuns>* cases, BenchReport* report) {
  if (!arguments.count) {
    report->notes.push_back("instructions and cache misses: not counted (--count)");
    return;
  }
  const EventCounter counter = FindEventCounter(arguments.out);
  if (counter == EventCounter::kNone) {
    report->notes.push_back(
        "instructions and cache misses: not counted, perf does not count here and valgrind is not "
        "installed");
    return;
  }
  report->notes.push_back(fmt::format(
      "instructions and cache misses: by {}, a frame of the second half of {} frames, one thread",
      NameOf(counter), arguments.counted_frames));
  const int times = counter == EventCounter::kPerf ? arguments.repetitions : 1;
  for (CaseRuns& runs : *cases) {
    Say(fmt::format("{}: counting by {}", runs.bench_case.name, NameOf(counter)));
    for (int i = 0; i < times; ++i) Count(arguments, counter, &runs);
  }
}

std::string VersionOf(const std::string& lamina, const std::string& log) {
  RunChildWell({lamina, "--version"}, log);
  std::string version = ReadFile(log);
  while (!version.empty() && version.back() == '\n') version.pop_back();
  return version;
}

BenchReport Measure(const BenchArguments& arguments) {
  BenchReport report;
  report.program = VersionOf(arguments.program, OutPath(arguments, "version.txt"));
  report.machine = DescribeMachine();
  std::vector<CaseRuns> cases;
  for (BenchCase& bench_case : ChosenCases(arguments)) {
    Say(fmt::format("{}: opening", bench_case.name));
    cases.push_back(OpenCase(arguments, std::move(bench_case)));
  }
  report.machine["load_before"] = MachineLoad();
  for (int i = 0; i < arguments.repetitions; ++i) {
    Say(fmt::format("run {} of {}", i + 1, arguments.repetitions));
    for (CaseRuns& runs : cases) Repeat(arguments.program, OutPath(arguments, "run"), &runs);
    // There and back, so that no case always follows the same one.
    std::reverse(cases.begin(), cases.end());
  }
  if (arguments.repetitions % 2 == 1) std::reverse(cases.begin(), cases.end());
  report.machine["load_after"] = MachineLoad();
  CountAll(arguments, &cases, &report);
  for (CaseRuns& runs : cases)
    report.rows.insert(report.rows.end(), runs.rows.begin(), runs.rows.end());
  return report;
}

std::string Page(const BenchReport& report) {
  std::string text =
      fmt::format("{}; {}\n\n{}", report.program, MachineText(report.machine), BenchTable(report));
  text +=
      "\nMedians (quartiles) of interleaved runs; ms a frame. floor_ms: reading each scan and "
      "hashing each point once into clusters. Stages: cpu_ms, divided as their wall times are.\n";
  for (const std::string& note : report.notes) text += "\n" + note + "\n";
  return text;
}

int RunScaling(BenchArguments arguments) {
  ScalingOptions& options = arguments.scaling_options;
  options.lamina = arguments.program;
  options.folder = arguments.out;
  options.repetitions = arguments.repetitions;
  options.threads = arguments.threads;
  if (arguments.frames > 0) options.frames = arguments.frames;
  nlohmann::json machine = DescribeMachine();
  machine["load_before"] = MachineLoad();
  const std::vector<ScalingStudy> studies = StudyScaling(options, Say);
  machine["load_after"] = MachineLoad();
  const std::string page = MachineText(machine) + "\n\n" + ScalingTable(studies);
  const nlohmann::json json = {{"machine", machine}, {"scaling", ToJson(studies)}};
  WriteTextFile(OutPath(arguments, "scaling.md"), page);
  WriteTextFile(OutPath(arguments, "scaling.json"), json.dump(1) + "\n");
  DrawPicture([&](const std::string& path) { return ScalingScript(studies, path); },
              OutPath(arguments, "scaling.svg"));
  fmt::print("{}\ntable   {}\nfigures {}\npicture {}\n", page, OutPath(arguments, "scaling.md"),
             OutPath(arguments, "scaling.json"), OutPath(arguments, "scaling.svg"));
  return 0;
}

void CheckArguments(const BenchArguments& arguments) {
  const auto at_least = [](const char* name, int value, int least) {
    if (value < least)
      throw OptionError(fmt::format("{} = {}: must be at least {}", name, value, least));
  };
  at_least("--frames", arguments.frames, 0);
  at_least("--repetitions", arguments.repetitions, 1);
  at_least("--counted-frames", arguments.counted_frames, 2);
  for (const int threads : arguments.threads) at_least("--threads", threads, 1);
}

int RunBench(BenchArguments arguments) {
  CheckArguments(arguments);
  if (arguments.program.empty()) arguments.program = ProgramBeside("lamina");
  // Before minutes of measuring.
  BenchReport before;
  if (!arguments.against.empty()) before = ReadBenchReport(arguments.against);
  MakeDirectory(arguments.out);
  if (arguments.scaling) return RunScaling(std::move(arguments));
  const BenchReport report =
      arguments.results.empty() ? Measure(arguments) : ReadBenchReport(arguments.results);
  std::string page = Page(report);
  if (!arguments.against.empty())
    page += fmt::format("\nAgainst {}; {}\n\n{}", before.program, MachineText(before.machine),
                        AgainstTable(before, report));
  WriteTextFile(OutPath(arguments, "bench.json"), ToJson(report).dump(1) + "\n");
  WriteTextFile(OutPath(arguments, "bench.md"), page);
  fmt::print("{}\ntable   {}\nfigures {}\n", page, OutPath(arguments, "bench.md"),
             OutPath(arguments, "bench.json"));
  return 0;
}

void AddScalingOptions(CLI::App* command, BenchArguments* a) {
  ScalingOptions& o = a->scaling_options;
  command->add_flag("--scaling", a->scaling,
                    "How the cost of a frame grows with points, window, map and threads, instead "
                    "of the cases: scaling.md, scaling.json, scaling.svg");
  command->add_option("--scaling-points", o.points, "Points a scan, a,b,c")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--scaling-windows", o.windows, "Frames of the window")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--scaling-lengths", o.lengths, "Scans of the drive, for the size of the map")
      ->delimiter(',')
      ->capture_default_str();
}

}  // namespace

void AddBenchCommand(CLI::App* app, std::function<int()>* run) {
  const auto arguments = std::make_shared<BenchArguments>();
  BenchArguments& a = *arguments;
  CLI::App* command = app->add_subcommand("bench", PurposeOfLabCommand("bench"));
  command->add_option("--out", a.out, "Folder for bench.md, bench.json, recordings and runs")
      ->required();
  command->add_option("--program", a.program, "The program to measure; this one if left out");
  command->add_option("--case", a.cases,
                      "NAME=SCANS,CONFIG: one more recording; may be given repeatedly");
  command
      ->add_option("--only", a.only, "Names of cases, a,b,c; hdl64, vlp16 and avia are generated")
      ->delimiter(',');
  command
      ->add_option("--frames", a.frames,
                   "Scans of each case; 0: 100 generated ones, all of a recorded one")
      ->capture_default_str();
  command->add_option("--threads", a.threads, "Numbers of threads, a,b,c")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--repetitions", a.repetitions, "Runs of each case and number of threads")
      ->capture_default_str();
  command->add_flag("--count", a.count,
                    "Count instructions and cache misses: perf stat, or callgrind, which takes "
                    "minutes");
  command
      ->add_option("--counted-frames", a.counted_frames,
                   "Scans of each case that --count counts in")
      ->capture_default_str();
  command->add_option("--against", a.against,
                      "A bench.json of an earlier measurement: what changed, and what is noise");
  command->add_option("--results", a.results,
                      "A bench.json to show or compare instead of measuring anew");
  AddScalingOptions(command, arguments.get());
  command->callback([arguments, run] { *run = [arguments] { return RunBench(*arguments); }; });
}

}  // namespace lamina
