#include "tools/promises/trial.h"

#include <time.h>

#include <fmt/format.h>

#include <atomic>
#include <memory>
#include <utility>

#include "backend/calibration/opening_calibration.h"
#include "backend/mapping/mapping.h"
#include "backend/session/scan_record.h"
#include "config/config.h"
#include "core/base/error.h"
#include "tools/synth/command.h"

namespace lamina {
namespace {

double ThreadCpuSeconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

// Scans made when they are asked for, and the time that takes.
class TimedSource final : public ScanSource {
 public:
  explicit TimedSource(std::shared_ptr<const SynthSequence> sequence)
      : scans_(std::move(sequence)) {}
  std::size_t size() const override { return scans_.size(); }
  std::string Name(std::size_t i) const override { return scans_.Name(i); }
  StampNs Stamp(std::size_t i) const override { return scans_.Stamp(i); }
  bool recorded_stamps() const override { return scans_.recorded_stamps(); }
  Scan Read(std::size_t i) const override {
    const double start = ThreadCpuSeconds();
    Scan scan = scans_.Read(i);
    microseconds_ += static_cast<std::int64_t>(1e6 * (ThreadCpuSeconds() - start));
    return scan;
  }
  double seconds() const { return 1e-6 * static_cast<double>(microseconds_); }

 private:
  SynthScanSource scans_;
  mutable std::atomic<std::int64_t> microseconds_{0};
};

std::shared_ptr<const SynthSequence> MakeSequence(const Promise& promise, int seed) {
  SynthOptions options = ParseSynthOptions(promise.synth);
  options.seed += seed - SynthOptions().seed;
  return std::make_shared<const SynthSequence>(options);
}

LaminaConfig ConfigOf(const Promise& promise, const std::vector<std::string>& set) {
  // Poses are judged scan by scan as odometry has them.
  std::vector<std::string> key_values = {"loops.enabled=false"};
  key_values.insert(key_values.end(), promise.set.begin(), promise.set.end());
  key_values.insert(key_values.end(), set.begin(), set.end());
  return LoadConfig(promise.config, key_values);
}

}  // namespace

void CheckTrial(const Promise& promise, const std::vector<std::string>& set) {
  try {
    MakeSequence(promise, 1);
    ConfigOf(promise, set);
  } catch (const OptionError& error) {
    throw OptionError(fmt::format("promise {}: {}", promise.name, error.what()));
  }
}

Trial MapTrial(const Promise& promise, int seed, const std::vector<std::string>& set) {
  const auto sequence = MakeSequence(promise, seed);
  const TimedSource source(sequence);

  Trial trial;
  trial.frames.resize(source.size());
  for (std::size_t i = 0; i < source.size(); ++i) {
    trial.frames[i].stamp_ns = source.Stamp(i);
    trial.frames[i].T_world_lidar_true = sequence->TruePose(i);
  }
  std::vector<ScanRecord> records(source.size());
  MappingCallbacks callbacks;
  callbacks.on_scan = [&](const MappedScan& report) {
    const ScanRecord& record = records[report.index] = RecordOf(report);
    TrialFrame& frame = trial.frames[report.index];
    frame.piece = report.piece;
    frame.T_world_matched = record.T_world_lidar;
    frame.covariance = record.covariance;
    frame.worst_sigma_m = record.worst_sigma_m;
  };
  callbacks.on_final_pose = [&](const FinalPose& pose) {
    TrialFrame& frame = trial.frames[pose.scan];
    frame.T_world_lidar = pose.pose.T_world_lidar;
    if (pose.given_up) records[pose.scan].GiveUp();
    frame.status = records[pose.scan].status;
  };
  const LaminaConfig config = ConfigOf(promise, set);
  const double start = ThreadCpuSeconds();
  std::unique_ptr<Mapping> run;
  const auto begin = [&](const MappingOptions& options) {
    run = std::make_unique<Mapping>(options, callbacks);
    return run.get();
  };
  MapWithBeamCorrection(source, 0, source.size(), config.Mapping(), config.calibration, begin);
  run->Finish();
  trial.cpu_s = ThreadCpuSeconds() - start - source.seconds();
  return trial;
}

}  // namespace lamina
