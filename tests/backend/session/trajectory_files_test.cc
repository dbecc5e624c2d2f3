#include "backend/session/trajectory_files.h"

#include <memory>

#include "tests/support/files/file_size_limit.h"
#include "tests/support/files/io_test_files.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

// Scans with random poses, one in seven skipped; the last ones open, with other poses as long as
// they are.
class TrajectoryFilesTest : public FilesTest {
 protected:
  void AddScans(int count) {
    database_->Begin();
    for (int i = 0; i < count; ++i) {
      ScanRecord scan;
      scan.scan = static_cast<std::int64_t>(scans_.size());
      scan.file = std::to_string(scan.scan);
      scan.stamp_ns = 100000000 * scan.scan;
      scan.skipped = draws_.Integer(0, 6) == 0;
      scan.T_world_lidar = draws_.Pose(100.0);
      scans_.push_back(
          {static_cast<std::size_t>(scan.scan), {scan.stamp_ns, scan.T_world_lidar}, scan.skipped});
      database_->Put(scan);
    }
    database_->Commit();
  }
  std::vector<FinalPose> Open(std::size_t count) {
    std::vector<FinalPose> open;
    for (std::size_t i = scans_.size() - count; i < scans_.size(); ++i) {
      FinalPose pose = scans_[i];
      pose.pose.T_world_lidar = draws_.Pose(100.0);
      open.push_back(pose);
    }
    return open;
  }
  void Publish(TrajectoryFiles* files, const std::vector<FinalPose>& open) const {
    files->Publish(*database_, static_cast<std::int64_t>(scans_.size()), open);
  }
  // Against the writers of whole trajectories.
  void ExpectPublished(const std::vector<FinalPose>& open) const {
    Trajectory kitti, tum;
    for (FinalPose pose : scans_) {
      const std::size_t final = scans_.size() - open.size();
      if (pose.scan >= final) pose = open[pose.scan - final];
      kitti.push_back(pose.pose);
      if (!pose.skipped) tum.push_back(pose.pose);
    }
    WriteKittiTrajectory(Path("kitti.txt"), kitti);
    WriteTumTrajectory(Path("tum.txt"), tum);
    EXPECT_TRUE(Bytes(Path("trajectory_kitti.txt")) == Bytes(Path("kitti.txt")));
    EXPECT_TRUE(Bytes(Path("trajectory_tum.txt")) == Bytes(Path("tum.txt")));
  }

  Draws draws_{1};
  std::vector<FinalPose> scans_;
  std::unique_ptr<SessionDatabase> database_ =
      std::make_unique<SessionDatabase>(Path("session.db"), false);
};

// More scans at once than are read from the database at once, and later lives of the process.
TEST_F(TrajectoryFilesTest, EachPublicationIsTheWholeTrajectorySoFar) {
  auto files = std::make_unique<TrajectoryFiles>(folder_.string());
  std::size_t open = 0;
  for (const int more : {0, 1, 20, 2500, 3, 0, 1, 40}) {
    SCOPED_TRACE(more);
    AddScans(more);
    // What was final stays so.
    open = std::min<std::size_t>(open + static_cast<std::size_t>(more), 15);
    // An open pose of a skipped scan gives way to that of its own points, if it ever had one.
    std::vector<FinalPose> tail = Open(open);
    Publish(files.get(), tail);
    for (FinalPose& pose : tail) {
      if (pose.scan % 2 == 0 && !pose.skipped) pose = scans_[pose.scan];
    }
    Publish(files.get(), tail);
    ExpectPublished(tail);
    if (more == 3) files = std::make_unique<TrajectoryFiles>(folder_.string());
  }
  Publish(files.get(), {});
  ExpectPublished({});
}

TEST_F(TrajectoryFilesTest, ALatePublicationWritesNoMoreThanAnEarlyOne) {
  TrajectoryFiles files(folder_.string());
  const auto cost = [&] {
    AddScans(50);
    const std::vector<FinalPose> open = Open(15);
    const std::uint64_t before = BytesWritten();
    Publish(&files, open);
    return BytesWritten() - before;
  };
  for (int i = 0; i < 3; ++i) cost();
  const std::uint64_t early = cost();
  AddScans(5000);
  for (int i = 0; i < 3; ++i) cost();
  EXPECT_LT(cost(), early + early / 5);
  EXPECT_GT(Bytes(Path("trajectory_kitti.txt")).size(), 10 * early);
}

TEST_F(TrajectoryFilesTest, WhatOnePublicationFailedToWriteTheNextOneWrites) {
  TrajectoryFiles files(folder_.string());
  AddScans(30);
  Publish(&files, Open(10));
  const std::string before = Bytes(Path("trajectory_kitti.txt"));
  AddScans(3000);
  std::vector<FinalPose> open = Open(10);
  {
    const FileSizeLimit limit(300000);
    EXPECT_THROW(Publish(&files, open), OutputError);
    EXPECT_EQ(Bytes(Path("trajectory_kitti.txt")), before);
  }
  AddScans(5);
  open = Open(10);
  Publish(&files, open);
  ExpectPublished(open);
}

}  // namespace
}  // namespace lamina
