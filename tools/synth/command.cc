#include "tools/synth/command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "tools/cli/common.h"
#include "tools/cli/options.h"
#include "tools/commands.h"
#include "tools/synth/writer.h"

namespace lamina {
namespace {

// What the command line gives; choices by name, as typed.
struct SynthArguments {
  std::string directory;
  std::string sensor = "hdl64", scene = "street", route = "winding";
  std::string layout = "kitti", profile = "constant";
  std::vector<int> spray;  // first scan, number of scans
  SynthOptions options;
  bool frames_given = false, noise_given = false, sensor_given = false;
  int lines = StationOptions().lines;
  int threads = 0;
};

std::string OneOf(const std::string& text, const std::vector<std::string>& names) {
  return fmt::format("{}: {}", text, fmt::join(names, ", "));
}

constexpr const char* kStationSensor = "utm30lx";

bool IsStationScene(const std::string& name) {
  const auto& names = StationSceneNames();
  return std::find(names.begin(), names.end(), name) != names.end();
}

WrittenSequence WriteStationScene(const SynthArguments& arguments, const SynthProgress& progress) {
  StationOptions options;
  options.scene = ByName<StationScene>("--scene", arguments.scene, StationSceneNames());
  options.scans = arguments.frames_given ? arguments.options.frames : 0;
  options.seed = arguments.options.seed;
  options.lines = arguments.lines;
  if (arguments.noise_given) options.noise_m = arguments.options.noise_m;
  const auto layout = ByName<StationLayout>("--layout", arguments.layout, {"kitti", "ethz"});
  return WriteStations(options, layout, arguments.directory, progress);
}

// Of scenes of a sensor that is carried on all the while.
SynthOptions MovingSceneOptions(const SynthArguments& arguments) {
  SynthOptions options = arguments.options;
  options.sensor = ByName<synth::SensorKind>("--sensor", arguments.sensor, synth::SensorNames());
  options.scene = ByName<synth::SceneKind>("--scene", arguments.scene, synth::SceneNames());
  options.route = ByName<synth::RouteKind>("--route", arguments.route, synth::RouteNames());
  options.profile.kind =
      ByName<synth::ProfileKind>("--profile", arguments.profile, synth::ProfileNames());
  if (!arguments.spray.empty()) {
    options.weather.spray_first = arguments.spray[0];
    options.weather.spray_scans = arguments.spray[1];
  }
  return options;
}

int RunSynth(const SynthArguments& arguments) {
  const auto limit = LimitThreads(arguments.threads);
  const auto start = std::chrono::steady_clock::now();
  // Progress goes to the error stream, so that the result line stands alone.
  const SynthProgress progress = [](std::size_t done, std::size_t all) {
    if (done / 500 != (done - 1) / 500) fmt::print(stderr, "{} of {} scans\n", done, all);
  };
  const bool stations = IsStationScene(arguments.scene);
  if (stations != (arguments.sensor == kStationSensor) && arguments.sensor_given) {
    throw OptionError(fmt::format("--sensor {} --scene {}: {} goes with {}, and with nothing else",
                                  arguments.sensor, arguments.scene, kStationSensor,
                                  fmt::join(StationSceneNames(), ", ")));
  }
  if (!stations && arguments.layout != "kitti") {
    throw OptionError("--layout ethz: is for a scanner that stands still, --scene " +
                      fmt::format("{}", fmt::join(StationSceneNames(), ", ")));
  }
  const WrittenSequence written =
      stations ? WriteStationScene(arguments, progress)
               : WriteSequence(MovingSceneOptions(arguments), arguments.directory, progress);
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
  fmt::print("{} frames, {} points ({} a frame) in {:.1f} s, {:.1f} frames/s; truth: {}\n",
             written.frames, written.points, written.points / written.frames, elapsed.count(),
             static_cast<double>(written.frames) / elapsed.count(), written.truth_path);
  return 0;
}

void AddErrorOptions(CLI::App* command, synth::SensorErrorOptions* o) {
  command
      ->add_option("--beam-elevation-offset-deg", o->beam_elevation_offset_deg,
                   "every beam points higher than reported by this angle")
      ->capture_default_str();
  command
      ->add_option("--beam-elevation-sigma-deg", o->beam_elevation_sigma_deg,
                   "standard deviation of each beam's error of elevation")
      ->capture_default_str();
  command
      ->add_option("--beam-range-sigma-m", o->beam_range_sigma_m,
                   "standard deviation of each beam's constant error of range")
      ->capture_default_str();
  command
      ->add_option("--incidence-bias-m", o->incidence_bias_m,
                   "error of the range at grazing incidence; with 1 - cosine of the angle")
      ->capture_default_str();
  command
      ->add_option("--time-offset-s", o->time_offset_s,
                   "error of the points' times; shows with --sweep")
      ->capture_default_str();
  command
      ->add_option("--dropped-packets", o->dropped_packets,
                   "share of the packets, 75 a scan, that never arrive")
      ->capture_default_str();
}

void AddWeatherOptions(CLI::App* command, SynthArguments* a) {
  command
      ->add_option("--rain", a->options.weather.rain,
                   "share of the rays that a drop within 15 m returns")
      ->capture_default_str();
  command
      ->add_option("--spray", a->spray,
                   "FIRST,COUNT: so many scans from this one on are nothing but noise at 1 to 8 m")
      ->delimiter(',')
      ->expected(2);
}

void AddMotionOptions(CLI::App* command, SynthArguments* a) {
  synth::ProfileOptions& o = a->options.profile;
  command
      ->add_option("--profile", a->profile,
                   OneOf("how the sensor moves along its way", synth::ProfileNames()))
      ->capture_default_str();
  command->add_option("--rest-s", o.rest_s, "start, brake: how long it stands; 0: brake 1.5")
      ->capture_default_str();
  command->add_option("--lean-deg", o.lean_deg, "how far the sensor leans forward on its carrier")
      ->capture_default_str();
  command->add_option("--gap-s", o.gap_s, "gaps: how long each lasts; 0: 0.5 to 3 s")
      ->capture_default_str();
  command->add_option("--turn-deg", o.turn_deg, "spin: degrees a scan")->capture_default_str();
  command->add_option("--shake-deg", o.shake_deg, "shake: degrees to either side, about each axis")
      ->capture_default_str();
  command->add_option("--shake-m", o.shake_m, "shake: metres to either side, along each axis")
      ->capture_default_str();
  command->add_option("--shake-hz", o.shake_hz, "shake: times a second")->capture_default_str();
  command->add_flag("--untimed", a->options.untimed, "write no times.txt: no stamps were recorded");
}

void AddOptions(CLI::App* command, SynthArguments* a) {
  SynthOptions& o = a->options;
  command
      ->add_option(
          "--frames", o.frames,
          "number of scans, 10 a second; stations: at most 60, as many as the scene has if "
          "left out")
      ->capture_default_str();
  command
      ->add_option("--sensor", a->sensor,
                   OneOf("model of the sensor", synth::SensorNames()) +
                       "; utm30lx, a tilted 2D scanner, goes with the scenes of stations")
      ->capture_default_str();
  command
      ->add_option("--scene", a->scene,
                   OneOf("surroundings", synth::SceneNames()) +
                       OneOf("; stations of a scanner that stands still", StationSceneNames()))
      ->capture_default_str();
  command->add_option("--lines", a->lines, "stations: planes of rays a scan")
      ->capture_default_str();
  command
      ->add_option("--layout", a->layout,
                   "stations: kitti, or ethz, the layout of that data set (Hokuyo_N.csv)")
      ->capture_default_str();
  command->add_option("--seed", o.seed, "another seed, another place, motion and noise")
      ->capture_default_str();
  command->add_option("--noise", o.noise_m, "standard deviation of the range, m")
      ->capture_default_str();
  command->add_option("--movers", o.movers, "number of moving cars and people")
      ->capture_default_str();
  command->add_flag("--sweep", o.sweep,
                    "fire each ray from where the sensor is at that instant (rolling sweep)");
  command
      ->add_option("--speed", o.speed_m_per_s,
                   "mean speed of the sensor, m/s; 0: 10 in a street, else on foot")
      ->capture_default_str();
  command
      ->add_option("--route", a->route, OneOf("street, city: where to drive", synth::RouteNames()))
      ->capture_default_str();
  command
      ->add_option(
          "--loop-blocks", o.loop_blocks,
          "street, city: blocks (96 x 64 m) along each side of a loop, or of the town of a "
          "tour")
      ->capture_default_str();
  command
      ->add_option("--drive", o.drive,
                   "city: drives of other numbers begin elsewhere, go another way, and find other "
                   "cars parked")
      ->capture_default_str();
  command
      ->add_option("--points", o.points,
                   "rays a scan, most of which return a point; 0: as many as the sensor has")
      ->capture_default_str();
  command->add_option("--rings", o.rings, "beams of --sensor spinning and scattered; 0: 64")
      ->capture_default_str();
  AddMotionOptions(command, a);
  AddWeatherOptions(command, a);
  AddErrorOptions(command, &o.errors);
}

}  // namespace

SynthOptions ParseSynthOptions(const std::vector<std::string>& texts) {
  SynthArguments arguments;
  for (const std::string& text : texts) {
    CLI::App app;
    AddOptions(&app, &arguments);
    try {
      app.parse(text, false);
    } catch (const CLI::ParseError& error) {
      throw OptionError(fmt::format("options of lamina synth '{}': {}", text, error.what()));
    }
  }
  return MovingSceneOptions(arguments);
}

void AddSynthCommand(CLI::App* app, std::function<int()>* run) {
  CLI::App* command = app->add_subcommand("synth", PurposeOfLabCommand("synth"));
  const auto arguments = std::make_shared<SynthArguments>();
  command->add_option("--out", arguments->directory, "directory to write into; created if need be")
      ->required();
  AddOptions(command, arguments.get());
  AddThreadsOption(command, ". The bytes are the same", &arguments->threads);
  command->callback([arguments, run, command] {
    arguments->frames_given = command->count("--frames") > 0;
    arguments->noise_given = command->count("--noise") > 0;
    arguments->sensor_given = command->count("--sensor") > 0;
    *run = [arguments] { return RunSynth(*arguments); };
  });
}

}  // namespace lamina
