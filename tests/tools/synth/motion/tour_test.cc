#include "tools/synth/motion/tour.h"

#include <gtest/gtest.h>

#include <map>
#include <utility>
#include <vector>

#include "tools/synth/motion/route.h"

namespace lamina::synth {
namespace {

TEST(Tour, ComesBackToWhereItBeganAndStaysInTheTown) {
  constexpr int kStepX[] = {1, 0, -1, 0}, kStepY[] = {0, 1, 0, -1};
  int with_opposite = 0;
  for (std::uint64_t key = 0; key < 200; ++key) {
    const int size = 1 + static_cast<int>(key % 5);
    const Tour tour = MakeTour(size, 40, key);
    Eigen::Vector2i at = tour.start;
    int quarter = tour.quarter, blocks = 0;
    // How often each street was driven, by the crossing that it begins at and the direction.
    std::map<std::vector<int>, int> driven;
    for (const RouteLeg& leg : tour.legs) {
      EXPECT_NE(leg.turn_after, 0);
      for (int i = 0; i < leg.blocks; ++i, ++blocks) {
        ++driven[{at.x(), at.y(), quarter}];
        at += Eigen::Vector2i(kStepX[quarter], kStepY[quarter]);
        ASSERT_TRUE((at.array() >= 0).all() && (at.array() <= size).all());
      }
      quarter = (quarter + leg.turn_after + 4) % 4;
    }
    EXPECT_EQ(at, tour.start);
    EXPECT_EQ(quarter, tour.quarter);
    EXPECT_GE(blocks, 40);
    std::size_t both = 0;
    for (const auto& [street, times] : driven) {
      both += driven.count(
          {street[0] + kStepX[street[2]], street[1] + kStepY[street[2]], (street[2] + 2) % 4});
    }
    with_opposite += both > 0 ? 1 : 0;
  }
  // Around a single block there is no other direction; that is a fifth of them.
  EXPECT_GT(with_opposite, 150);
}

TEST(Tour, TheRouteIsSmoothAndRepeatsItself) {
  const Route route(RouteKind::kTour, 3, {96.0, 64.0}, 7);
  RoutePoint before = route.At(0.0);
  for (double s = 0.5; s < 1.5 * route.period_m(); s += 0.5) {
    const RoutePoint point = route.At(s);
    const double step = (point.position - before.position).norm();
    ASSERT_NEAR(step, 0.5, 1e-2) << s;
    before = point;
  }
  EXPECT_LT((route.At(10.0).position - route.At(10.0 + route.period_m()).position).norm(), 1e-6);
  const Route other(RouteKind::kTour, 3, {96.0, 64.0}, 8);
  EXPECT_NE(other.period_m(), route.period_m());
}

}  // namespace
}  // namespace lamina::synth
