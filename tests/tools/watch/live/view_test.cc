// The board between the mapping thread and those who ask.
#include "tools/watch/live/view.h"

#include "tests/tools/watch/live/live_server_fixture.h"

namespace lamina {
namespace {

TEST(LiveView, KeepsNewPosesInFullAndThinsOldOnes) {
  LiveView view(100);
  for (int i = 0; i < 5000; ++i) view.AddFrame(FrameAt(i));
  const TrajectoryPage page = view.Trajectory(-1, -1);
  ASSERT_LE(page.poses.size(), 200U);
  ASSERT_GT(page.poses.size(), 140U);
  EXPECT_EQ(page.poses.front().index, 0);
  for (std::size_t i = 1; i < page.poses.size(); ++i) {
    EXPECT_LT(page.poses[i - 1].index, page.poses[i].index);
    EXPECT_LE(page.poses[i].index - page.poses[i - 1].index, 128);
  }
  EXPECT_EQ(page.poses[page.poses.size() - 100].index, 4900);
  EXPECT_THROW(view.AddFrame(FrameAt(4999)), std::logic_error);
}

TEST(LiveView, TimingsAreTheNewest) {
  LiveView view;
  EXPECT_EQ(view.Timings(0).times.size(), 0U);
  for (int i = 0; i < 1000; ++i) view.AddFrame(FrameAt(i));
  EXPECT_EQ(view.Timings(0).first, 400U);
  EXPECT_EQ(view.Timings(0).times.size(), 600U);
  const TimingPage page = view.Timings(998);
  ASSERT_EQ(page.times.size(), 2U);
  EXPECT_EQ(page.times[0].lag_ms, 998.0F);
  EXPECT_EQ(view.Timings(5000).times.size(), 0U);
  EXPECT_EQ(view.Report().latency_median_ms, 700.0);
  EXPECT_EQ(view.Report().latency_p99_ms, 994.0);
}

}  // namespace
}  // namespace lamina
