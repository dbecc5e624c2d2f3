#include "tools/run/joined_run.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/support/files/io_test_files.h"
#include "tests/support/scenes/mapped_drives.h"
#include "tools/results/piece_poses.h"

namespace lamina {
namespace {

class JoinedRunTest : public FilesTest {};

TEST_F(JoinedRunTest, PiecesThatSawOnePlaceShareTheFrameOfTheFirst) {
  const Town town(1);
  const std::vector<SE3> there = Drive({{-60, -60}, {60, -60}, {60, 60}});
  const std::vector<SE3> back = Drive({{60, 30}, {60, -60}, {-60, -60}});
  const MappedDrive first = MapDrive(town, there, 3);
  const MappedDrive elsewhere = MapDrive(Town(12), there, 4);
  const MappedDrive second = MapDrive(town, back, 5);
  LaminaConfig config;
  config.loops = DriveLoopOptions();
  const JoinedRun run({{0, first.loops.get()}, {2, elsewhere.loops.get()}, {5, second.loops.get()}},
                      config);
  EXPECT_TRUE(run.moved());
  EXPECT_EQ(run.joins(), (std::map<std::int64_t, std::int64_t>{{5, 0}}));
  EXPECT_EQ(run.FrameOf(2), 2);
  EXPECT_EQ(run.FrameOf(7), 7);  // without a submap
  const StampedPose& last = second.odometry.back();
  const SE3 corrected = run.Corrected(5, last.stamp_ns, last.T_world_lidar);
  EXPECT_LT((there[0] * corrected.t - back.back().t).norm(), 1.0);
  const std::vector<SubmapFrameView> frames = run.Frames();
  ASSERT_EQ(frames.size(), 2U);
  EXPECT_EQ(frames[0].submaps.size(),
            first.loops->submaps().size() + second.loops->submaps().size());
  EXPECT_EQ(frames[0].pieces.back(), 5);
  EXPECT_FALSE(frames[0].graph.loops.empty());

  VoxelMap map(config.map);
  run.AddTo(&map);
  EXPECT_TRUE(map.HasPiece(2));
  EXPECT_FALSE(map.HasPiece(5));
}

TEST_F(JoinedRunTest, FramesCsvTellsTheFrameAndTheOwnPiece) {
  Write("frames.csv", "scan,status,piece\n0,first,0\n1,first,2\n2,tracked,5\n");
  AddFrameColumn(Path("frames.csv"), {{5, 0}});
  EXPECT_EQ(Bytes(Path("frames.csv")),
            "scan,status,piece,frame\n0,first,0,0\n1,first,2,2\n2,tracked,5,0\n");
  const std::vector<FrameRow> rows = ReadFrameRows(folder_.string());
  ASSERT_EQ(rows.size(), 3U);
  EXPECT_EQ(rows[2].piece, 0);
  EXPECT_EQ(rows[2].own_piece, 5);
  EXPECT_EQ(rows[2].status, "tracked");
}

}  // namespace
}  // namespace lamina
