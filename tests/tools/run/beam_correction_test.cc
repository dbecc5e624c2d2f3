// Beams that are off are corrected at the opening of a run, and nothing else is.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <vector>

#include "backend/calibration/opening_calibration.h"
#include "core/base/angle.h"
#include "tests/support/program/run_helpers.h"
#include "tools/synth/engine/sensor_errors.h"
#include "tools/synth/sequence.h"

namespace lamina {
namespace {

using testing::HasSubstr;
using Outcomes = OpeningCalibration::Outcome;

// A sensor whose beams are off by half of what a badly calibrated one's are.
SynthOptions HalfKnown(int frames) {
  SynthOptions synth;
  synth.frames = frames;
  synth.sensor = synth::SensorKind::kSpinning;
  synth.rings = 64;
  synth.points = 20000;
  synth.noise_m = 0.01;
  synth.errors.beam_elevation_offset_deg = 0.25;
  synth.errors.beam_elevation_sigma_deg = 0.15;
  synth.errors.beam_range_sigma_m = 0.025;
  return synth;
}

struct CorrectedDrive {
  OpeningCalibration opening;
  int begun = 0;         // mappings
  double error_m = 0.0;  // of the last pose, from the first
  double way_m = 0.0;    // from the first to the last
  std::size_t lost = 0;
};

CorrectedDrive Map(const SynthOptions& synth, const std::string& correction,
                   MappingOptions options = MappingOptions()) {
  const auto sequence = std::make_shared<const SynthSequence>(synth);
  const SynthScanSource source(sequence);
  options.loops.enabled = false;
  if (correction == "off")
    options.preparation.beam_correction = ScanPreparationOptions::BeamCorrection::kOff;
  CorrectedDrive drive;
  SE3 last;
  MappingCallbacks callbacks;
  callbacks.on_final_pose = [&](const FinalPose& pose) { last = pose.pose.T_world_lidar; };
  std::unique_ptr<Mapping> mapping;
  const auto begin = [&](const MappingOptions& with) {
    ++drive.begun;
    mapping = std::make_unique<Mapping>(with, callbacks);
    return mapping.get();
  };
  const MappedRecording mapped =
      MapWithBeamCorrection(source, 0, source.size(), options, CalibrationOptions(), begin);
  EXPECT_EQ(mapped.mapping, mapping.get());
  EXPECT_EQ(mapped.processed, source.size());
  mapping->Finish();
  drive.opening = mapped.opening;
  const SE3 truth = sequence->TruePose(source.size() - 1);
  drive.error_m = (last.t - truth.t).norm();
  drive.way_m = truth.t.norm();
  drive.lost = mapping->counts().lost;
  return drive;
}

// What beams have wrong, against what the generator did.
void ExpectTrue(const std::vector<BeamOffset>& beams, const SynthOptions& synth) {
  constexpr double kHighestDeg = 15.0, kLowestDeg = -25.0;
  const synth::SensorErrors errors(synth.errors, static_cast<std::size_t>(synth.rings), synth.seed);
  double elevation2 = 0.0, range2 = 0.0;
  for (const BeamOffset& beam : beams) {
    const auto ring = static_cast<std::size_t>(std::lround(
        (kHighestDeg - beam.elevation_deg) / (kHighestDeg - kLowestDeg) * (synth.rings - 1)));
    const Eigen::Vector3d fired = errors.Fired(ring, Eigen::Vector3d::UnitX());
    const double off_deg =
        beam.elevation_correction_deg - Degrees(std::atan2(fired.z(), fired.x()));
    const double off_m = beam.range_correction_m + errors.RangeBias(ring, 1.0);
    elevation2 += off_deg * off_deg;
    range2 += off_m * off_m;
  }
  ASSERT_GT(beams.size(), 50U);
  // From 0.3 degrees and 2.5 cm.
  EXPECT_LT(std::sqrt(elevation2 / static_cast<double>(beams.size())), 0.12);
  EXPECT_LT(std::sqrt(range2 / static_cast<double>(beams.size())), 0.01);
}

TEST(BeamCorrection, ATownBySuchASensorDriftsNoMore) {
  const SynthOptions synth = HalfKnown(60);
  const CorrectedDrive as_it_is = Map(synth, "off");
  const CorrectedDrive corrected = Map(synth, "auto");
  EXPECT_EQ(as_it_is.opening.outcome, Outcomes::kNotLookedFor);
  ASSERT_EQ(corrected.opening.outcome, Outcomes::kCorrected) << corrected.opening.why;
  EXPECT_EQ(corrected.begun, 2);
  ExpectTrue(corrected.opening.beams, synth);
  EXPECT_LT(corrected.opening.after.median_m, 0.6 * corrected.opening.before.median_m);
  EXPECT_LT(corrected.error_m, 0.1 * as_it_is.error_m);
  // What the scene is promised (tools/promises/promises.md), in per cent of the way.
  EXPECT_LT(100.0 * corrected.error_m / corrected.way_m, 0.2);
}

// Rays at any elevation: an angle for all of them is what can be found.
TEST(BeamCorrection, WithoutConesOneAngleIsFoundForAll) {
  SynthOptions synth = HalfKnown(60);
  synth.sensor = synth::SensorKind::kScattered;
  synth.errors = {};
  synth.errors.beam_elevation_offset_deg = 0.4;
  const CorrectedDrive as_it_is = Map(synth, "off");
  const CorrectedDrive corrected = Map(synth, "auto");
  ASSERT_EQ(corrected.opening.outcome, Outcomes::kCorrected) << corrected.opening.why;
  EXPECT_TRUE(corrected.opening.beams.empty());
  EXPECT_NEAR(Degrees(corrected.opening.elevation_rad), 0.4, 0.12);
  EXPECT_LT(3.0 * corrected.opening.sigma_rad, corrected.opening.elevation_rad);
  EXPECT_LT(corrected.error_m, 0.3 * as_it_is.error_m);
}

// Noise thickens planes as much as beams do that are off, but no correction of beams thins them.
TEST(BeamCorrection, ANoisySensorIsLookedAtAndLeftAsItIs) {
  SynthOptions synth = HalfKnown(60);
  synth.errors = {};
  synth.noise_m = 0.03;
  const CorrectedDrive drive = Map(synth, "auto");
  ASSERT_EQ(drive.opening.outcome, Outcomes::kRefused);
  EXPECT_THAT(drive.opening.why, HasSubstr("as thick"));
  EXPECT_EQ(drive.begun, 1);
}

TEST(BeamCorrection, AWellKnownSensorIsNotTouched) {
  SynthOptions synth = HalfKnown(60);
  synth.errors = {};
  const CorrectedDrive drive = Map(synth, "auto");
  EXPECT_EQ(drive.opening.outcome, Outcomes::kNotLookedFor);
  EXPECT_EQ(drive.begun, 1);
}

TEST(BeamCorrection, AFieldDeterminesNothing) {
  SynthOptions synth = HalfKnown(60);
  synth.scene = synth::SceneKind::kField;
  const CorrectedDrive drive = Map(synth, "auto");
  EXPECT_NE(drive.opening.outcome, Outcomes::kCorrected);
}

// What a motion that no model follows bends, beams could make up for.
TEST(BeamCorrection, ASensorThatIsShakenIsRefused) {
  SynthOptions synth;
  synth.frames = 60;
  synth.scene = synth::SceneKind::kHall;
  synth.sensor = synth::SensorKind::kVlp16;
  synth.sweep = true;
  synth.profile.kind = synth::ProfileKind::kShake;
  synth.profile.shake_deg = 2.0;
  synth.profile.shake_hz = 3.3;
  MappingOptions by_hand;
  by_hand.mapper.backend.keyframe_translation_m = 0.1;
  by_hand.mapper.map.root_size_m = 2.0;
  const CorrectedDrive drive = Map(synth, "auto", by_hand);
  ASSERT_EQ(drive.opening.outcome, Outcomes::kRefused);
  EXPECT_THAT(drive.opening.why, HasSubstr("shaken"));
  EXPECT_EQ(drive.begun, 1);
}

TEST(BeamCorrection, MoreThanAnOptionAllowsIsRefused) {
  SynthOptions synth = HalfKnown(60);
  synth.errors.beam_elevation_offset_deg = 5.0;
  synth.errors.beam_elevation_sigma_deg = 0.5;
  const CorrectedDrive drive = Map(synth, "auto");
  ASSERT_EQ(drive.opening.outcome, Outcomes::kRefused);
  EXPECT_THAT(drive.opening.why, HasSubstr("must be in"));
  EXPECT_EQ(drive.begun, 1);
}

TEST(BeamCorrection, ASensorThatSeesToOneSideIsRefused) {
  SynthOptions synth = HalfKnown(60);
  synth.sensor = synth::SensorKind::kAvia;
  synth.rings = synth.points = 0;
  synth.noise_m = 0.05;
  const CorrectedDrive drive = Map(synth, "auto");
  ASSERT_EQ(drive.opening.outcome, Outcomes::kRefused);
  EXPECT_THAT(drive.opening.why, HasSubstr("one side"));
  EXPECT_EQ(drive.begun, 1);
}

class BeamCorrectionRunTest : public RunTest {
 protected:
  std::string WriteHalfKnown(int frames) const {
    const SynthSequence sequence(HalfKnown(frames));
    Recording recording;
    for (std::size_t i = 0; i < sequence.size(); ++i) {
      recording.push_back(
          {KittiBin(sequence.Generate(i).points), 1e-9 * static_cast<double>(sequence.Stamp(i))});
    }
    return WriteRecording("town", recording);
  }
};

// The same at any number of threads, and with the configuration that the run leaves.
TEST_F(BeamCorrectionRunTest, IsSaidAndRepeatsByItsConfiguration) {
  const std::string scans = WriteHalfKnown(55);
  const Outcome outcome = Run(scans, {"--threads", "1"});
  EXPECT_THAT(outcome.err, HasSubstr("preparation.beam_correction=off"));
  const nlohmann::json beams = Summary()["beam_correction"];
  ASSERT_TRUE(beams.is_object());
  EXPECT_EQ(beams["applied"], true);
  EXPECT_GT(beams["beams"].size(), 50U);
  EXPECT_LT(beams["median_thickness_m"], beams["median_thickness_uncorrected_m"]);
  EXPECT_EQ(Summary()["frames"], 55);
  Run(scans, {"--threads", "2"}, 0, "two");
  Run(scans, {"--config", Path("out/config.yaml")}, 0, "again");
  for (const char* file : {"trajectory_tum.txt", "map_surfels.ply", "config.yaml"}) {
    EXPECT_EQ(Bytes(Path(std::string("two/") + file)), Bytes(Path(std::string("out/") + file)));
    EXPECT_EQ(Bytes(Path(std::string("again/") + file)), Bytes(Path(std::string("out/") + file)));
  }
  EXPECT_FALSE(Summary("again").contains("beam_correction"));
  Run(scans, {"--set", "preparation.beam_correction=off"}, 0, "off");
  EXPECT_FALSE(Summary("off").contains("beam_correction"));
  EXPECT_NE(Bytes(Path("off/trajectory_tum.txt")), Bytes(Path("out/trajectory_tum.txt")));
}

}  // namespace
}  // namespace lamina
