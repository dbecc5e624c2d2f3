#include "backend/submaps/work_sharing.h"

#include <gtest/gtest.h>

#include <vector>

#include "backend/loops/piece_joining.h"
#include "tests/support/parts.h"
#include "tests/support/scenes/mapped_drives.h"

namespace lamina {
namespace {

TEST(ShareOut, EachItemIsDoneOnceAndAllGetAllInOrder) {
  const std::vector<std::size_t> owner = {2, 0, 1, 1, 0, 2, 2};
  std::vector<int> done(owner.size(), 0);
  std::vector<std::vector<double>> got(3);
  InParts(3, [&](const WorkSharing& sharing) {
    got[sharing.part] = ShareOut<double>(owner, sharing, [&](const std::vector<std::size_t>& mine) {
      std::vector<double> results;
      for (const std::size_t i : mine) {
        ++done[i];
        results.push_back(1.0 / (1.0 + static_cast<double>(i)));
      }
      return results;
    });
  });
  for (std::size_t i = 0; i < owner.size(); ++i) {
    EXPECT_EQ(done[i], 1);
    for (const auto& all : got) EXPECT_EQ(all.at(i), 1.0 / (1.0 + static_cast<double>(i)));
  }
}

TEST(JoinPieces, IsTheSameInAnyNumberOfParts) {
  const Town town(1);
  const MappedDrive first = MapDrive(town, Drive({{-60, -60}, {60, -60}}), 1);
  const MappedDrive second = MapDrive(town, Drive({{60, -60}, {-60, -60}}), 2);
  const std::vector<MapPiece> pieces = {{&first.loops->submaps(), first.loops->graph()},
                                        {&second.loops->submaps(), second.loops->graph()}};
  const auto join = [&](const WorkSharing& sharing) {
    return JoinPieces(pieces, DriveLoopOptions(), VoxelMapOptions(), ScanMatcherOptions(), sharing);
  };
  const JoinedPieces alone = join({});
  ASSERT_FALSE(alone.loops.empty());
  std::vector<JoinedPieces> shared(2);
  InParts(2, [&](const WorkSharing& sharing) { shared[sharing.part] = join(sharing); });
  for (const JoinedPieces& joined : shared) {
    EXPECT_EQ(joined.part, alone.part);
    ASSERT_EQ(joined.loops.size(), alone.loops.size());
    for (std::size_t i = 0; i < alone.loops.size(); ++i) {
      EXPECT_EQ(joined.loops[i].match.T_other_query.t, alone.loops[i].match.T_other_query.t);
      EXPECT_EQ(joined.loops[i].status, alone.loops[i].status);
    }
    for (std::size_t i = 0; i < alone.graph.poses.size(); ++i)
      EXPECT_EQ(joined.graph.poses[i].t, alone.graph.poses[i].t);
  }
}

}  // namespace
}  // namespace lamina
