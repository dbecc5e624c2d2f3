// Two sensors on one vehicle, one of which looks back: one piece, one odometry, poses of the
// vehicle.
#include <gmock/gmock.h>

#include "tests/support/program/session_scenes.h"

namespace lamina {
namespace {

constexpr int kVehicleScans = 30;  // of each sensor
constexpr double kReachM = 4.0;
constexpr StampNs kVehiclePeriodNs = 100'000'000;

class VehicleTest : public SessionTest {
 protected:
  VehicleTest() {
    options_.T_vehicle_lidar = {
        {"front", SE3(ExpSO3({0.0, 0.02, 0.1}), {0.6, 0.0, 0.1})},
        {"rear", SE3(ExpSO3({0.0, -0.03, M_PI}), {-0.7, 0.1, 0.0})},
    };
  }
  // Scans of both in the order of their stamps, those of the rear one so much later.
  Recording Drive(StampNs rear_later_ns) const {
    const Corridor corridor(kReachM + 12.0);
    Recording recording;
    recording.options = options_;
    for (int i = 0; i < 2 * kVehicleScans; ++i) {
      const bool rear = i % 2 == 1;
      InboxFile file;
      file.sequence = rear ? "rear" : "front";
      file.name = file.sequence + "/" + std::to_string(1000 + i) + ".bin";
      file.stamp_ns = i / 2 * kVehiclePeriodNs + (rear ? rear_later_ns : 0);
      file.recorded_stamp = true;
      if (i < 2) file.next_stamp_ns = file.stamp_ns + kVehiclePeriodNs;
      const int pose =
          2 * (i / 2) + (2 * file.stamp_ns % (2 * kVehiclePeriodNs) == kVehiclePeriodNs ? 1 : 0);
      recording.truth.push_back(Corridor::PoseAt(pose, 2 * kVehicleScans, kReachM));
      const SE3 T_world_lidar = recording.truth.back() * options_.T_vehicle_lidar.at(file.sequence);
      file.path =
          Write("inbox/" + file.name, corridor.Scan(T_world_lidar, static_cast<unsigned>(i)));
      recording.files.push_back(file);
    }
    return recording;
  }
  struct Mapped {
    std::vector<FinalPose> poses;
    std::vector<Surfel> surfels;
    MappingCounts counts;
  };
  Mapped MapAll(const Recording& recording) const {
    Mapped mapped;
    Session session(Setup("session"), {});
    Map(&session, recording, static_cast<std::int64_t>(recording.files.size()));
    session.Finish();
    session.ForEachPose([&](const FinalPose& pose) { mapped.poses.push_back(pose); });
    session.mapping().map().ForEachSurface(1,
                                           [&](const Surfel& s) { mapped.surfels.push_back(s); });
    mapped.counts = session.mapping().counts();
    return mapped;
  }
  ScanSourceOptions options_;
};

TEST_F(VehicleTest, BothSensorsMakeOneMapAndPosesOfTheVehicle) {
  const Recording recording = Drive(kVehiclePeriodNs / 2);
  const Mapped mapped = MapAll(recording);
  EXPECT_EQ(mapped.counts.pieces, 1U);
  EXPECT_EQ(mapped.counts.frames, 2U * kVehicleScans);
  EXPECT_EQ(mapped.counts.lost, 0U);
  double worst = 0.0;
  for (std::size_t i = 0; i < mapped.poses.size(); ++i) {
    const SE3 should = recording.truth[0].Inverse() * recording.truth[i];
    worst = std::max(worst, (mapped.poses[i].pose.T_world_lidar.t - should.t).norm());
  }
  EXPECT_LT(worst, 0.03);
  RecordProperty("worst_mm", std::to_string(1e3 * worst));
  // The walls along the corridor, which both have seen, are where they are.
  int walls = 0;
  for (const Surfel& s : mapped.surfels) {
    if (std::abs(s.normal.y()) < 0.95) continue;
    ++walls;
    EXPECT_LT(std::min(std::abs(s.centre.y() - 2.1), std::abs(s.centre.y() + 1.9)), 0.03)
        << s.centre.transpose();
  }
  EXPECT_GT(walls, 20);
}

TEST_F(VehicleTest, WithoutThePosesOfTheSensorsEachIsAPieceOfItsOwn) {
  Recording recording = Drive(kVehiclePeriodNs / 2);
  recording.options = {};
  EXPECT_EQ(MapAll(recording).counts.pieces, 2U);
}

// From two poses at about the same time no velocity could be told.
TEST_F(VehicleTest, OfSensorsThatAreTriggeredTogetherOneIsMappedAndTheOtherCounted) {
  for (const StampNs later_ns : {StampNs{0}, StampNs{3'000'000}}) {
    const Recording recording = Drive(later_ns);
    std::filesystem::remove_all(Path("session"));
    const Mapped mapped = MapAll(recording);
    EXPECT_EQ(mapped.counts.frames, static_cast<std::size_t>(kVehicleScans));
    EXPECT_EQ(mapped.counts.skipped.at(SkipReason::kTooSoonAfterOtherSensor),
              static_cast<std::size_t>(kVehicleScans));
    EXPECT_EQ(mapped.counts.lost, 0U);
  }
}

}  // namespace
}  // namespace lamina
