// Loops in the stream: a place that is visited again corrects the map while it is mapped.
#include <gtest/gtest.h>

#include <map>
#include <string>
#include <vector>

#include "backend/loops/piece_loops.h"
#include "backend/mapping/mapping.h"
#include "core/base/parallel.h"
#include "tests/support/memory_byte_store.h"
#include "tests/support/memory_voxel_store.h"
#include "tests/support/scenes/drifting_drive.h"

namespace lamina {
namespace {

constexpr double kStepM = 1.2, kShare = 0.01;

const Town& TheTown() {
  static const Town town(1, 90.0);
  return town;
}
const std::vector<SE3>& Truth() {
  static const std::vector<SE3> truth = Laps(kStepM, 300.0);
  return truth;
}
const std::vector<Scan>& Scans() {
  static const std::vector<Scan> scans = CrookedScans(TheTown(), Truth(), kShare);
  return scans;
}

struct Outcome {
  std::vector<MappedScan> scans;
  std::vector<SE3> odometry, corrected;  // final poses
  std::size_t planes = 0;                // of the map that scans were matched to
  std::size_t accepted = 0;
  std::size_t leaves = 0;  // of submaps, in memory
  std::string bits;
};

Outcome MapLaps(bool loops, ByteStore* submaps = nullptr) {
  Outcome outcome;
  std::vector<FinalPose> poses;
  MappingCallbacks callbacks;
  callbacks.on_final_pose = [&](const FinalPose& pose) { poses.push_back(pose); };
  MemoryVoxelStore store;
  Mapping mapping(LapOptions(loops), callbacks, &store, submaps);
  for (const Scan& scan : Scans()) outcome.scans.push_back(mapping.Add(scan));
  StateArchive bits;
  mapping.map().ForEachSurface(2, [&](Surfel s) {
    ++outcome.planes;
    bits(&s.centre, &s.normal, &s.count);
  });
  mapping.Finish();
  for (FinalPose& pose : poses) {
    bits(&pose.pose);
    outcome.odometry.push_back(pose.pose.T_world_lidar);
    outcome.corrected.push_back(pose.pose.T_world_lidar);
    if (mapping.loops() == nullptr) continue;
    outcome.corrected.back() =
        mapping.loops()->Corrected(pose.piece, pose.pose.stamp_ns, pose.pose.T_world_lidar);
    bits(&outcome.corrected.back());
  }
  if (mapping.loops() != nullptr) {
    for (const auto& [piece, closure] : mapping.loops()->pieces()) {
      for (const Submap& submap : closure->submaps()) outcome.leaves += submap.leaves.size();
      for (const Loop& loop : closure->loops())
        outcome.accepted += loop.status == Loop::Status::kAccepted ? 1 : 0;
    }
  }
  outcome.bits = bits.written();
  return outcome;
}

const Outcome& WithLoops() {
  static const Outcome outcome = MapLaps(true);
  return outcome;
}
const Outcome& WithoutLoops() {
  static const Outcome outcome = MapLaps(false);
  return outcome;
}

// How far a pose is from where it should be, seen from the pose one lap earlier.
double OffTheFirstLap(std::size_t i, const SE3& T_map_lidar, const std::vector<SE3>& map) {
  const auto lap = static_cast<std::size_t>(std::lround((4 * 20 + 40 * M_PI) / kStepM));
  const SE3 there = map[i - lap].Inverse() * T_map_lidar;
  const SE3 truth = Truth()[i - lap].Inverse() * Truth()[i];
  return (there.t - truth.t).norm();
}

// Where the first lap lies in the map, a metre off by then, planes say as much for a scan: that is
// no reason to lose a sensor which is where it was expected.
TEST(LoopsInTheStream, AnEarlierLapThatHasDriftedLosesNoScan) {
  constexpr double kPerM2 = 2.5;
  const std::vector<SE3> truth = Laps(kStepM, 255.0);
  Mapping mapping(LapOptions(false));
  for (const Scan& scan : CrookedScans(TheTown(), truth, kShare, kPerM2)) mapping.Add(scan);
  EXPECT_EQ(mapping.counts().lost, 0U);
}

TEST(LoopsInTheStream, LaterScansAreWhereTheFirstLapWas) {
  const Outcome &on = WithLoops(), &off = WithoutLoops();
  const std::size_t last = on.scans.size() - 1;
  ASSERT_GE(on.accepted, 2U);
  // The drift of a lap.
  ASSERT_GT(OffTheFirstLap(last, off.scans[last].odometry.T_world_lidar, off.odometry), 0.7);
  // As known when the last scans came, long before the end.
  for (std::size_t i = last - 20; i <= last; ++i) {
    const MappedScan& scan = on.scans[i];
    EXPECT_LT(OffTheFirstLap(i, scan.T_map_world * scan.odometry.T_world_lidar, on.corrected), 0.3)
        << i;
  }
}

TEST(LoopsInTheStream, TheSecondLapIsMatchedToThePlanesOfTheFirst) {
  // Without, what was passed twice stands there twice.
  EXPECT_LT(static_cast<double>(WithLoops().planes),
            0.85 * static_cast<double>(WithoutLoops().planes));
}

TEST(LoopsInTheStream, PosesOfOdometryDoNotJump) {
  const Outcome& on = WithLoops();
  for (std::size_t i = 1; i < on.scans.size(); ++i) {
    const SE3 step =
        on.scans[i - 1].odometry.T_world_lidar.Inverse() * on.scans[i].odometry.T_world_lidar;
    const SE3 truth = Truth()[i - 1].Inverse() * Truth()[i];
    EXPECT_LT((step.t - truth.t).norm(), 0.3) << i;
    EXPECT_FALSE(on.scans[i].odometry.status == OdometryFrame::Status::kLost) << i;
  }
}

// Nor does the number of threads.
TEST(LoopsInTheStream, SubmapsThatAreStoredLeaveMemoryAndNothingElseChanges) {
  WithLoops();
  const ThreadLimit limit(1);
  MemoryByteStore store;
  const Outcome outcome = MapLaps(true, &store);
  EXPECT_EQ(outcome.bits, WithLoops().bits);
  EXPECT_EQ(outcome.leaves, 0U);
  EXPECT_EQ(store.size(), WithLoops().leaves * sizeof(SubmapLeaf));
  EXPECT_GT(store.reads, 0);
}

TEST(LoopsInTheStream, NothingOfTheMappingChangesBeforeALoop) {
  const Outcome &on = WithLoops(), &off = WithoutLoops();
  std::size_t i = 0;
  for (; i < on.scans.size() && on.scans[i].T_map_world.t.norm() == 0.0; ++i) {
    EXPECT_EQ(on.scans[i].odometry.T_world_lidar.t, off.scans[i].odometry.T_world_lidar.t) << i;
  }
  EXPECT_GT(i, on.scans.size() / 2);
  EXPECT_LT(i, on.scans.size());
}

}  // namespace
}  // namespace lamina
