#include "tools/calibrate/command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <array>
#include <cmath>
#include <memory>
#include <string>

#include "config/config.h"
#include "core/base/angle.h"
#include "core/base/error.h"
#include "tools/cli/common.h"
#include "tools/cli/options.h"

namespace lamina {
namespace {

struct CalibrateArguments {
  std::string scans, frames;
  std::string progress = "auto";
  ConfigArguments config;
  int threads = 0;
};

// One of the two unknowns, in the units of its option.
struct Unknown {
  const char *name, *option, *unit;
  double value, sigma, limit;
  bool determined;
};

std::array<Unknown, 2> Unknowns(const RecordingCalibration& calibration,
                                const CalibrationOptions& options) {
  const CalibrationResult& result = calibration.result;
  return {{{"elevation offset", "vertical_correction_deg", "deg", Degrees(calibration.offsets(0)),
            Degrees(result.sigma(0)), options.max_elevation_sigma_deg, result.determined[0]},
           {"range offset", "range_offset_m", "m", calibration.offsets(1), result.sigma(1),
            options.max_range_sigma_m, result.determined[1]}}};
}

std::string DescribeUnknown(const Unknown& u) {
  if (!u.determined) {
    return fmt::format("{}: not determined, sigma {:.4f} {} is above {} {}; stays at {:.4f} {}\n",
                       u.name, u.sigma, u.unit, u.limit, u.unit, u.value, u.unit);
  }
  return fmt::format("{}: {:.4f} {}, sigma {:.4f} {}\n", u.name, u.value, u.unit, u.sigma, u.unit);
}

std::string DescribePass(const CalibrationPass& pass) {
  return fmt::format(
      "pass {}: {} frames mapped with {:.4f} deg, {:.4f} m ({} lost), planes {:.1f} mm thick "
      "(median of {})\n",
      pass.pass + 1, pass.frames, Degrees(pass.offsets(0)), pass.offsets(1), pass.lost,
      1e3 * pass.map.median_m, pass.map.planes);
}

int Calibrate(const CalibrateArguments& arguments) {
  const auto limit = LimitThreads(arguments.threads);
  const LaminaConfig config = LoadConfig(arguments.config.file, arguments.config.set);
  if (!config.scans.T_vehicle_lidar.empty()) {
    throw OptionError(
        "calibrate and scans.T_vehicle_lidar exclude each other: angles and ranges are those of "
        "one "
        "sensor; give its folder as --scans, and no option scans.T_vehicle_lidar");
  }
  const auto source = OpenScans(arguments.scans, config.scans);
  const FrameRange range = ParseFrameRange(arguments.frames, source->size());
  const std::atomic<bool>& stop = StopOnSignals();
  const auto new_progress = [&] {
    return std::make_unique<RunProgress>(ProgressMode(arguments.progress), range.end - range.begin);
  };
  std::unique_ptr<RunProgress> progress = new_progress();
  const auto on_scan = [&](const MappedScan& report) {
    if (report.skipped) {
      progress->Warn(fmt::format("skipped scan {}: {}", report.index, report.detail));
    }
    progress->Step();
  };
  const auto on_pass = [&](const CalibrationPass& pass) {
    progress->Finish();
    progress = new_progress();
    if (arguments.progress != "off") fmt::print(stderr, "{}", DescribePass(pass));
  };
  MappingOptions mapping = config.Mapping();
  mapping.loops.enabled = false;
  const RecordingCalibration calibration = CalibrateRecording(
      *source, range.begin, range.end, mapping, config.calibration, on_scan, on_pass, &stop);
  if (calibration.result.status == CalibrationResult::Status::kInterrupted) {
    throw InterruptedError("nothing was found");
  }
  const std::string report = DescribeCalibration(calibration, config.calibration);
  if (calibration.result.status == CalibrationResult::Status::kNotDetermined) {
    throw InputError(arguments.scans + ": neither offset is determined\n" + report);
  }
  fmt::print("{}", report);
  return 0;
}

}  // namespace

std::string DescribeCalibration(const RecordingCalibration& calibration,
                                const CalibrationOptions& options) {
  const auto unknowns = Unknowns(calibration, options);
  std::string text;
  for (const Unknown& u : unknowns) text += DescribeUnknown(u);
  if (calibration.result.status == CalibrationResult::Status::kNotDetermined) {
    return text +
           "a drive is needed on which flat ground or walls are seen from near and far: longer, or "
           "with calibration.frame_spacing_share lowered for one of a few metres";
  }
  text += fmt::format("planes of the map: {:.1f} mm thick before, {:.1f} mm after (median)\n",
                      1e3 * calibration.passes.front().map.median_m,
                      1e3 * calibration.passes.back().map.median_m);
  if (!calibration.settled) {
    text += "the last pass still changed the offsets by more than sigma: take them with care\n";
  }
  text += "\npreparation:\n";
  for (const Unknown& u : unknowns) {
    if (u.determined) text += fmt::format("  {}: {:.4f}\n", u.option, u.value);
  }
  return text;
}

void AddCalibrateCommand(CLI::App* app, std::function<int()>* run) {
  auto arguments = std::make_shared<CalibrateArguments>();
  CalibrateArguments& a = *arguments;
  CLI::App* command = app->add_subcommand(
      "calibrate",
      "Find the offsets of the sensor's elevation angles and ranges that make its map thinnest, "
      "and print the lines that put them into a configuration");
  command->add_option("--scans", a.scans, "Recording, as for `lamina run`")->required();
  AddTopicOption(command, &a.config);
  AddConfigOptions(command, "; calibration.* is for this command", &a.config);
  AddFramesOption(command, &a.frames);
  AddThreadsOption(command, "", &a.threads);
  AddProgressOption(command, &a.progress);
  command->callback([arguments, run] { *run = [arguments] { return Calibrate(*arguments); }; });
}

}  // namespace lamina
