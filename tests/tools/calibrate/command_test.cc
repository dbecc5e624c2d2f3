// `lamina calibrate`, on generated recordings whose sensor is off by known offsets.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "backend/calibration/recording_calibration.h"
#include "core/base/angle.h"
#include "tests/support/memory_scans.h"
#include "tests/support/program/run_helpers.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

// The point as a sensor reports it whose elevation and range are off.
ScanPoint Misread(const ScanPoint& p, double elevation_deg, double range_m) {
  const double rho = std::hypot(p.x, p.y);
  const double range = std::hypot(rho, p.z) + range_m;
  const double elevation = std::atan2(p.z, rho) + Radians(elevation_deg);
  const double flat = range * std::cos(elevation) / rho;
  return {static_cast<float>(p.x * flat), static_cast<float>(p.y * flat),
          static_cast<float>(range * std::sin(elevation)), p.intensity};
}

std::vector<Scan> MisreadStreet(int frames, int seed, double elevation_deg, double range_m) {
  SynthOptions options;
  options.frames = frames;
  options.seed = seed;
  options.sensor = synth::SensorKind::kVlp16;
  const SynthSequence sequence(options);
  std::vector<Scan> scans;
  for (std::size_t i = 0; i < sequence.size(); ++i) {
    scans.push_back(sequence.Generate(i));
    for (ScanPoint& p : scans.back().points) p = Misread(p, elevation_deg, range_m);
  }
  return scans;
}

// Two scans of one recording, one of the other, and so on.
class TwoRecordings final : public ScanSource {
 public:
  TwoRecordings(std::vector<Scan> a, std::vector<Scan> b) : a_(std::move(a)), b_(std::move(b)) {}
  std::size_t size() const override { return std::min(a_.size() / 2, b_.size()) * 3; }
  std::string Name(std::size_t i) const override { return "scan " + std::to_string(i); }
  std::string Recording(std::size_t i) const override { return i % 3 < 2 ? "a" : "b"; }
  StampNs Stamp(std::size_t i) const override { return At(i).stamp_ns; }
  Scan Read(std::size_t i) const override { return At(i); }

 private:
  const Scan& At(std::size_t i) const {
    return i % 3 < 2 ? a_.at(i / 3 * 2 + i % 3) : b_.at(i / 3);
  }
  std::vector<Scan> a_, b_;
};

RecordingCalibration Calibrate(const ScanSource& scans) {
  return CalibrateRecording(scans, 0, scans.size(), MappingOptions(), CalibrationOptions(), nullptr,
                            nullptr);
}

TEST(Calibrate, FindsTheOffsetsOfAStreet) {
  struct Case {
    int seed;
    double elevation_deg, range_m;
  };
  for (const Case& c : {Case{1, 0.3, -0.03}, Case{2, 0.0, 0.0}}) {
    const RecordingCalibration found =
        Calibrate(MemoryScans(MisreadStreet(30, c.seed, c.elevation_deg, c.range_m)));
    EXPECT_EQ(found.result.status, CalibrationResult::Status::kConverged);
    EXPECT_TRUE(found.settled);
    EXPECT_NEAR(Degrees(found.offsets(0)), -c.elevation_deg, 0.01);
    EXPECT_NEAR(found.offsets(1), -c.range_m, 0.003);
    EXPECT_LT(Degrees(found.result.sigma(0)), 0.01);
    EXPECT_LT(found.result.sigma(1), 0.005);
    EXPECT_LE(found.passes.back().map.median_m, found.passes.front().map.median_m + 1e-4);
  }
}

TEST(Calibrate, KeepsFramesApartThatNothingConnects) {
  const RecordingCalibration found =
      Calibrate(TwoRecordings(MisreadStreet(30, 1, 0.3, 0.0), MisreadStreet(15, 2, 0.3, 0.0)));
  EXPECT_TRUE(found.settled);
  EXPECT_NEAR(Degrees(found.offsets(0)), -0.3, 0.02);
}

class CalibrateCommandTest : public RunTest {};

TEST_F(CalibrateCommandTest, PrintsLinesThatAConfigurationTakes) {
  Recording recording;
  SynthOptions options;
  options.frames = 30;
  options.sensor = synth::SensorKind::kVlp16;
  const SynthSequence sequence(options);
  for (std::size_t i = 0; i < sequence.size(); ++i) {
    std::vector<ScanPoint> points = sequence.Generate(i).points;
    for (ScanPoint& p : points) p = Misread(p, -0.4, 0.0);
    recording.push_back({KittiBin(points), 1e-9 * static_cast<double>(sequence.Stamp(i))});
  }
  const std::string scans = WriteRecording("street", recording);
  const Outcome outcome = Lamina({"calibrate", "--scans", scans});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("elevation offset: 0."), HasSubstr("sigma"),
                                 HasSubstr("\npreparation:\n  vertical_correction_deg: 0.")));
  const std::size_t yaml = outcome.out.find("preparation:");
  ASSERT_NE(yaml, std::string::npos);
  Write("found.yaml", outcome.out.substr(yaml));
  Run(scans, {"--config", Path("found.yaml")});
  EXPECT_THAT(Bytes(Path("out/config.yaml")), HasSubstr("vertical_correction_deg: 0."));
}

TEST_F(CalibrateCommandTest, PrintsEachBeam) {
  SynthOptions options;
  options.frames = 30;
  options.sensor = synth::SensorKind::kVlp16;
  options.errors.beam_elevation_sigma_deg = 0.3;
  const SynthSequence sequence(options);
  Recording recording;
  for (std::size_t i = 0; i < sequence.size(); ++i) {
    recording.push_back(
        {KittiBin(sequence.Generate(i).points), 1e-9 * static_cast<double>(sequence.Stamp(i))});
  }
  const std::string scans = WriteRecording("street", recording);
  const Outcome outcome = Lamina({"calibrate", "--beams", "--scans", scans});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("16 beams"));
  const std::size_t yaml = outcome.out.find("preparation:");
  ASSERT_NE(yaml, std::string::npos);
  Write("found.yaml", outcome.out.substr(yaml));
  Run(scans, {"--config", Path("found.yaml")});
  EXPECT_THAT(Bytes(Path("out/config.yaml")), HasSubstr("  beams:\n    - ["));
  const Outcome again =
      Lamina({"calibrate", "--beams", "--scans", WriteRepeated("standing", Street(1)[0].bytes, 5)});
  EXPECT_EQ(again.code, 1);
  EXPECT_THAT(again.err, HasSubstr("no beam is corrected"));
}

TEST_F(CalibrateCommandTest, AStandingSensorIsRefused) {
  const std::string scans = WriteRepeated("standing", Street(1)[0].bytes, 10);
  const Outcome outcome = Lamina({"calibrate", "--scans", scans});
  EXPECT_EQ(outcome.code, 1);
  EXPECT_THAT(outcome.err, HasSubstr("hardly moves"));
  EXPECT_THAT(outcome.out, Not(HasSubstr("preparation:")));
}

}  // namespace
}  // namespace lamina
