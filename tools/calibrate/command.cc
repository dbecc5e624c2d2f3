#include "tools/calibrate/command.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

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
#include "tools/run/opening_choice.h"

namespace lamina {
namespace {

struct CalibrateArguments {
  std::string scans, frames;
  std::string progress = "auto";
  ConfigArguments config;
  int threads = 0;
  bool beams = false;
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

// The scans, and what a line of progress says of each that is mapped.
class CalibrationInput {
 public:
  CalibrationInput(const CalibrateArguments& arguments, const LaminaConfig& config)
      : source_(OpenScans(arguments.scans, config.scans)),
        range_(ParseFrameRange(arguments.frames, source_->size())),
        mode_(ProgressMode(arguments.progress)),
        quiet_(arguments.progress == "off") {
    // Sweeps that are taken for instantaneous bend what the sensor's angles are found by.
    const OpeningChoice choice = ChooseOpening(*source_, range_, config, nullptr, StopOnSignals());
    for (const std::string& warning : choice.Warnings()) spdlog::warn("{}", warning);
    mapping_ = choice.config.Mapping();
    mapping_.loops.enabled = false;
    BeginProgress();
  }

  const ScanSource& source() const { return *source_; }
  const FrameRange& range() const { return range_; }
  const MappingOptions& mapping() const { return mapping_; }

  void Tell(const MappedScan& report) {
    if (report.skipped) {
      progress_->Warn(fmt::format("skipped scan {}: {}", report.index, report.detail));
    }
    progress_->Step();
  }
  // All scans have been mapped once more.
  void EndPass(const std::string& line) {
    progress_->Finish();
    BeginProgress();
    if (!quiet_) fmt::print(stderr, "{}", line);
  }

 private:
  void BeginProgress() {
    progress_ = std::make_unique<RunProgress>(mode_, range_.end - range_.begin);
  }

  std::unique_ptr<ScanSource> source_;
  FrameRange range_;
  RunProgress::Mode mode_;
  bool quiet_;
  MappingOptions mapping_;
  std::unique_ptr<RunProgress> progress_;
};

int CalibrateOffsets(CalibrationInput* input, const CalibrationOptions& options,
                     const std::string& scans) {
  const RecordingCalibration calibration = CalibrateRecording(
      input->source(), input->range().begin, input->range().end, input->mapping(), options,
      [&](const MappedScan& report) { input->Tell(report); },
      [&](const CalibrationPass& pass) { input->EndPass(DescribePass(pass)); }, &StopOnSignals());
  if (calibration.result.status == CalibrationResult::Status::kInterrupted) {
    throw InterruptedError("nothing was found");
  }
  const std::string report = DescribeCalibration(calibration, options);
  if (calibration.result.status == CalibrationResult::Status::kNotDetermined) {
    throw InputError(scans + ": neither offset is determined\n" + report);
  }
  fmt::print("{}", report);
  return 0;
}

int CalibrateEachBeam(CalibrationInput* input, const CalibrationOptions& options,
                      const std::string& scans) {
  const std::atomic<bool>& stop = StopOnSignals();
  const RecordingBeams found = CalibrateRecordingBeams(
      input->source(), input->range().begin, input->range().end, input->mapping(), options,
      [&](const MappedScan& report) { input->Tell(report); }, &stop);
  if (stop.load()) throw InterruptedError("nothing was found");
  if (found.beams.empty()) throw InputError(scans + ": no beam is corrected: " + found.why);
  fmt::print("{}", DescribeBeams(found));
  return 0;
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
  CalibrationInput input(arguments, config);
  return arguments.beams ? CalibrateEachBeam(&input, config.calibration, arguments.scans)
                         : CalibrateOffsets(&input, config.calibration, arguments.scans);
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
  const double before_m = calibration.passes.front().map.median_m;
  const double after_m = calibration.passes.back().map.median_m;
  text += fmt::format("planes of the map: {:.1f} mm thick before, {:.1f} mm after (median)\n",
                      1e3 * before_m, 1e3 * after_m);
  if (after_m >= before_m)
    return text + "they are no thinner: the options are best left as they are\n";
  if (!calibration.settled) {
    text += "the last pass still changed the offsets by more than sigma: take them with care\n";
  }
  text += "\npreparation:\n";
  for (const Unknown& u : unknowns) {
    if (u.determined) text += fmt::format("  {}: {:.4f}\n", u.option, u.value);
  }
  return text;
}

std::string DescribeBeams(const RecordingBeams& found) {
  std::string text = fmt::format(
      "{} beams; points lie {:.1f} mm off their planes as reported, {:.1f} mm with these (root "
      "mean square)\n\npreparation:\n  beams:  # elevation, its correction (deg), range's (m)\n",
      found.beams.size(), 1e3 * found.thickness_before_m, 1e3 * found.thickness_m);
  for (const BeamOffset& beam : found.beams) {
    text += fmt::format("    - [{:.4f}, {:.4f}, {:.4f}]\n", beam.elevation_deg,
                        beam.elevation_correction_deg, beam.range_correction_m);
  }
  return text;
}

void AddCalibrateCommand(CLI::App* app, std::function<int()>* run) {
  auto arguments = std::make_shared<CalibrateArguments>();
  CalibrateArguments& a = *arguments;
  CLI::App* command = app->add_subcommand(
      "calibrate",
      "Find the offsets of the sensor's elevation angles and ranges that make its map thinnest, "
      "of all beams alike or of each, and print the lines that put them into a configuration");
  command->add_option("--scans", a.scans, "Recording, as for `lamina run`")->required();
  command->add_flag("--beams", a.beams,
                    "Offsets of each beam, for a spinning sensor whose scans were not deskewed");
  AddTopicOption(command, &a.config);
  AddConfigOptions(command, "; calibration.* is for this command", &a.config);
  AddFramesOption(command, &a.frames);
  AddThreadsOption(command, "", &a.threads);
  AddProgressOption(command, &a.progress);
  command->callback([arguments, run] { *run = [arguments] { return Calibrate(*arguments); }; });
}

}  // namespace lamina
