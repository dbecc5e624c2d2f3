// A sensor that was in the dark and is elsewhere when it sees again, while a map is made.
#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <vector>

#include "backend/mapping/mapping.h"
#include "core/base/parallel.h"
#include "tests/support/memory_voxel_store.h"
#include "tests/support/scenes/drifting_drive.h"

namespace lamina {
namespace {

constexpr StampNs kNightNs = 30'000'000'000;

struct LostOutcome {
  std::vector<MappedScan> scans;
  std::vector<SE3> truth;
  std::size_t dark = 0;  // scans before it
  MappingCounts counts;
  std::string bits;

  // How far off in the frame of the first piece.
  double ErrorM(std::size_t i) const {
    const SE3 T = truth[0] * scans[i].T_map_world * scans[i].odometry.T_world_lidar;
    return (T.t - truth[i].t).norm();
  }
  // Scans after the dark until the first one that is in the first piece again.
  std::optional<std::size_t> FoundAfter() const {
    for (std::size_t i = dark; i < scans.size(); ++i) {
      if (scans[i].piece == 0 && scans[i].odometry.status == OdometryFrame::Status::kTracked)
        return i - dark;
    }
    return std::nullopt;
  }
};

// Dark after `way_m` of a lap, and then back along 60 m of it, in the town `after`.
LostOutcome MapWithDark(const Town& after, double way_m) {
  static const Town town(1, 90.0);
  LostOutcome outcome;
  outcome.truth = Laps(1.2, way_m);
  std::vector<Scan> scans = CrookedScans(town, outcome.truth, 0.0);
  outcome.dark = scans.size();
  const std::vector<SE3> elsewhere = LapsBack(1.0, way_m - 15.0, way_m - 75.0);
  for (Scan& scan : CrookedScans(after, elsewhere, 0.0)) {
    scan.stamp_ns += scans[outcome.dark - 1].stamp_ns + kNightNs;
    scans.push_back(std::move(scan));
  }
  outcome.truth.insert(outcome.truth.end(), elsewhere.begin(), elsewhere.end());
  MemoryVoxelStore store;
  StateArchive bits;
  MappingCallbacks callbacks;
  callbacks.on_final_pose = [&](const FinalPose& pose) {
    std::int64_t piece = pose.piece;
    StampedPose stamped = pose.pose;
    bits(&piece, &stamped);
  };
  Mapping mapping(LapOptions(), callbacks, &store);
  for (const Scan& scan : scans) outcome.scans.push_back(mapping.Add(scan));
  mapping.Finish();
  outcome.counts = mapping.counts();
  outcome.bits = bits.written();
  return outcome;
}

// After the dark in the town that it was in before.
const LostOutcome& InTheSameTown() {
  static const LostOutcome outcome = MapWithDark(Town(1, 90.0), 110.0);
  return outcome;
}

TEST(LostWhileMapping, FoundWhereItHasBeenWithinThreeSeconds) {
  const LostOutcome& outcome = InTheSameTown();
  ASSERT_EQ(outcome.counts.found, 1U);
  const std::optional<std::size_t> after = outcome.FoundAfter();
  ASSERT_TRUE(after.has_value());
  EXPECT_LE(*after, 30U);
  for (std::size_t i = outcome.dark; i < outcome.dark + *after; ++i) {
    // Until then it is connected with nothing, and says so.
    EXPECT_TRUE(outcome.scans[i].piece != 0 ||
                outcome.scans[i].odometry.status == OdometryFrame::Status::kLost)
        << i;
  }
  for (std::size_t i = outcome.dark + *after; i < outcome.scans.size(); ++i) {
    EXPECT_EQ(outcome.scans[i].piece, 0) << i;
    EXPECT_LT(outcome.ErrorM(i), 0.2) << i;
  }
}

TEST(LostWhileMapping, WhereItHasNotBeenItStaysAPieceOfItsOwn) {
  const LostOutcome outcome = MapWithDark(Town(7, 90.0), 190.0);
  EXPECT_EQ(outcome.counts.found, 0U);
  EXPECT_FALSE(outcome.FoundAfter().has_value());
  EXPECT_EQ(outcome.scans.back().piece, 1);
}

TEST(LostWhileMapping, TheSameBitsAtAnyNumberOfThreads) {
  const std::string& bits = InTheSameTown().bits;
  const ThreadLimit limit(1);
  EXPECT_EQ(MapWithDark(Town(1, 90.0), 110.0).bits, bits);
}

}  // namespace
}  // namespace lamina
