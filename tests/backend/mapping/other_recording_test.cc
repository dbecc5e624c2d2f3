// A recording that begins where another one has been before, while a map is made.
#include <gmock/gmock.h>

#include <algorithm>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "backend/mapping/mapping.h"
#include "core/base/parallel.h"
#include "tests/support/memory_voxel_store.h"
#include "tests/support/scenes/drifting_drive.h"

namespace lamina {
namespace {

struct RecordedDrive {
  std::string recording;
  std::vector<SE3> truth;
  std::vector<Scan> scans;
};

const Town& HomeTown() {
  static const Town town(1, 90.0);
  return town;
}

RecordedDrive RecordedIn(const Town& town, const std::string& recording, std::vector<SE3> truth) {
  RecordedDrive drive{recording, std::move(truth), {}};
  drive.scans = CrookedScans(town, drive.truth, 0.0);
  return drive;
}

const RecordedDrive& There() {
  static const RecordedDrive drive = RecordedIn(HomeTown(), "there", Laps(1.2, 110.0));
  return drive;
}

// By a clock that is so much ahead.
RecordedDrive Later(RecordedDrive drive, double by_s) {
  for (Scan& scan : drive.scans) scan.stamp_ns += static_cast<StampNs>(1e9 * by_s);
  return drive;
}
constexpr double kHourS = 3600.0;

// Begins some seconds after the last stamp there.
const RecordedDrive& Back() {
  static const RecordedDrive drive =
      Later(RecordedIn(HomeTown(), "back", LapsBack(1.0, 95.0, 20.0)), 12.0);
  return drive;
}

struct MappedDrives {
  std::vector<MappedScan> scans;
  std::vector<SE3> truth;
  MappingCounts counts;
  std::string poses;

  // How far off in the frame of the first piece.
  double ErrorM(std::size_t i) const {
    const SE3 T = truth[0] * scans[i].T_map_world * scans[i].odometry.T_world_lidar;
    return (T.t - truth[i].t).norm();
  }
  // The first scan of another recording than the first that is in piece 0; all scans if none is.
  std::size_t Found(std::size_t after) const {
    const auto found = std::find_if(
        scans.begin() + static_cast<std::ptrdiff_t>(after), scans.end(),
        [](const MappedScan& scan) { return scan.recording != "there" && scan.piece == 0; });
    return static_cast<std::size_t>(found - scans.begin());
  }
  std::set<std::int64_t> PiecesOf(std::size_t begin, std::size_t end) const {
    std::set<std::int64_t> pieces;
    for (std::size_t i = begin; i < end; ++i) pieces.insert(scans[i].piece);
    return pieces;
  }
};

// A recording counts as silent after half of this.
constexpr int kFinalAfter = 40;

// Scans of recordings, in this order.
class InTurns {
 public:
  void Add(const RecordedDrive& drive, std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      order_.emplace_back(&drive, i);
      mapped_.truth.push_back(drive.truth[i]);
    }
  }
  void Add(const RecordedDrive& drive) { Add(drive, 0, drive.scans.size()); }

  MappedDrives Map() {
    MappingOptions options = LapOptions();
    options.mapper.backend.final_after_frames = kFinalAfter;
    StateArchive bits;
    MappingCallbacks callbacks;
    callbacks.on_final_pose = [&](const FinalPose& pose) {
      std::size_t scan = pose.scan;
      std::int64_t piece = pose.piece;
      StampedPose stamped = pose.pose;
      bits(&scan, &piece, &stamped);
      ++handed_on_;
    };
    MemoryVoxelStore store;
    Mapping mapping(options, callbacks, &store);
    for (const auto& [drive, i] : order_)
      mapped_.scans.push_back(mapping.Add(drive->scans[i], drive->recording));
    mapping.Finish();
    EXPECT_EQ(handed_on_, order_.size());
    mapped_.counts = mapping.counts();
    mapped_.poses = bits.written();
    return std::move(mapped_);
  }

 private:
  std::vector<std::pair<const RecordedDrive*, std::size_t>> order_;
  std::size_t handed_on_ = 0;
  MappedDrives mapped_;
};

MappedDrives MapThereAndBack() {
  InTurns drives;
  drives.Add(There());
  drives.Add(Back());
  return drives.Map();
}

const MappedDrives& ThereAndBack() {
  static const MappedDrives mapped = MapThereAndBack();
  return mapped;
}

TEST(OtherRecording, IsFoundInTheMapOfOneThatIsSilentAndGoesOnThere) {
  const MappedDrives& mapped = ThereAndBack();
  const std::size_t back = There().scans.size();
  const std::size_t found = mapped.Found(back);
  ASSERT_LT(found, mapped.scans.size());
  EXPECT_EQ(mapped.counts.found, 1U);
  EXPECT_LE(found - back, 60U);
  EXPECT_THAT(mapped.PiecesOf(back, found), testing::ElementsAre(1));
  EXPECT_THAT(mapped.PiecesOf(found, mapped.scans.size()), testing::ElementsAre(0));
  for (std::size_t i = found; i < mapped.scans.size(); ++i) EXPECT_LT(mapped.ErrorM(i), 0.05) << i;
}

TEST(OtherRecording, IsFoundSoonInTheMapOfOneThatEndedBeforeItBegan) {
  const RecordedDrive back = Later(Back(), kHourS);
  InTurns drives;
  drives.Add(There());
  drives.Add(back);
  const MappedDrives mapped = drives.Map();
  const std::size_t begun = There().scans.size();
  EXPECT_LE(mapped.Found(begun) - begun, 30U);
  EXPECT_LT(mapped.ErrorM(mapped.scans.size() - 1), 0.05);
}

TEST(OtherRecording, IsNotFoundWhereItHasNotBeen) {
  const Town elsewhere(7, 90.0);
  const RecordedDrive other =
      Later(RecordedIn(elsewhere, "elsewhere", LapsBack(1.0, 95.0, 20.0)), kHourS);
  InTurns drives;
  drives.Add(There());
  drives.Add(other);
  const MappedDrives mapped = drives.Map();
  EXPECT_EQ(mapped.counts.found, 0U);
  EXPECT_THAT(mapped.PiecesOf(There().scans.size(), mapped.scans.size()), testing::ElementsAre(1));
}

// Poses of a piece are corrected in the order of their stamps.
TEST(OtherRecording, IsNotLookedForWhereStampsAreLater) {
  InTurns drives;
  const RecordedDrive there = Later(There(), kHourS);
  drives.Add(there);
  drives.Add(Back());
  EXPECT_EQ(drives.Map().counts.found, 0U);
}

TEST(OtherRecording, IsNotLookedForInAPieceThatIsStillBeingMapped) {
  const RecordedDrive back = Later(Back(), kHourS);
  InTurns drives;
  std::size_t there = 0;
  for (std::size_t i = 0; i < back.scans.size(); ++i) {
    drives.Add(There(), there, there + 1);
    drives.Add(back, i, i + 1);
    if (++there == There().scans.size()) break;
  }
  const MappedDrives mapped = drives.Map();
  EXPECT_EQ(mapped.counts.found, 0U);
  EXPECT_EQ(mapped.counts.pieces, 2U);
}

TEST(OtherRecording, OneThatRestedGoesOnWhereItWas) {
  const Town elsewhere(7, 90.0);
  const RecordedDrive other =
      Later(RecordedIn(elsewhere, "elsewhere", LapsBack(1.0, 95.0, 20.0)), kHourS);
  const std::size_t half = There().scans.size() / 2;
  InTurns drives;
  drives.Add(There(), 0, half);
  drives.Add(other);
  drives.Add(There(), half, There().scans.size());
  const MappedDrives mapped = drives.Map();
  EXPECT_EQ(mapped.counts.pieces, 2U);
  const std::size_t again = half + other.scans.size();
  EXPECT_THAT(mapped.PiecesOf(again, mapped.scans.size()), testing::ElementsAre(0));
  for (std::size_t i = again; i < mapped.scans.size(); ++i) {
    EXPECT_EQ(mapped.scans[i].odometry.status, OdometryFrame::Status::kTracked) << i;
    EXPECT_LT(mapped.ErrorM(i), 0.05) << i;
  }
}

TEST(OtherRecording, OneWhosePieceAnotherHasTakenBeginsAPieceOfItsOwn) {
  const std::size_t half = There().scans.size() * 9 / 10;
  InTurns drives;
  drives.Add(There(), 0, half);
  drives.Add(Back());
  drives.Add(There(), half, There().scans.size());
  const MappedDrives mapped = drives.Map();
  EXPECT_EQ(mapped.counts.found, 1U);
  EXPECT_THAT(mapped.PiecesOf(half + Back().scans.size(), mapped.scans.size()),
              testing::ElementsAre(2));
}

TEST(OtherRecording, TheSameBitsAtAnyNumberOfThreads) {
  const std::string& poses = ThereAndBack().poses;
  const ThreadLimit limit(1);
  EXPECT_EQ(MapThereAndBack().poses, poses);
}

}  // namespace
}  // namespace lamina
