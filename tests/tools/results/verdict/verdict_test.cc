#include "tools/results/verdict/verdict.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

#include "tests/support/good_scan.h"

namespace lamina {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

constexpr int kMaxIterations = 20;

// A drive of 200 scans at 10 m/s, all as they should be but for what `change` does to scan i.
RunVerdict VerdictOn(const std::function<void(int i, ScanRecord* scan)>& change = {}) {
  VerdictCounter counter(kMaxIterations);
  for (int i = 0; i < 200; ++i) {
    ScanRecord scan = GoodScan(i);
    if (change) change(i, &scan);
    counter.Add(scan);
  }
  return counter.Judge();
}

TEST(RunVerdictTest, AGoodRunIsSaidToBe) {
  const RunVerdict verdict = VerdictOn();
  EXPECT_EQ(verdict.grade, RunVerdict::Grade::kGood);
  EXPECT_THAT(verdict.reasons, IsEmpty());
  EXPECT_EQ(ToString(verdict), "good");
}

TEST(RunVerdictTest, NoScansAndOneScanHaveNothingAgainstThem) {
  EXPECT_EQ(VerdictCounter(kMaxIterations).Judge().grade, RunVerdict::Grade::kGood);
  VerdictCounter counter(kMaxIterations);
  ScanRecord first;
  first.status = "first";
  counter.Add(first);
  EXPECT_EQ(counter.Judge().grade, RunVerdict::Grade::kGood);
}

TEST(RunVerdictTest, ScansThatAreSkippedCount) {
  const auto skipped = [](int of_ten) {
    return VerdictOn([of_ten](int i, ScanRecord* scan) { scan->skipped = i % 10 < of_ten; });
  };
  EXPECT_EQ(skipped(1).grade, RunVerdict::Grade::kDoubtful);
  EXPECT_EQ(skipped(6).grade, RunVerdict::Grade::kWrong);
  EXPECT_EQ(skipped(10).grade, RunVerdict::Grade::kWrong);
  EXPECT_THAT(ToString(skipped(6)), HasSubstr("60.0 % of the scans are skipped"));
  const RunVerdict pairs = VerdictOn([](int i, ScanRecord* scan) {
    scan->skipped = i % 2 == 1;
    if (scan->skipped) scan->status = "too_soon_after_other_sensor";
  });
  EXPECT_EQ(pairs.grade, RunVerdict::Grade::kGood);
}

TEST(RunVerdictTest, MotionsThatNoVehicleMakesAreWrong) {
  // Every tenth pose is half a metre off: 50 and more m/s^2.
  const auto off_each = [](int each) {
    return [each](int i, ScanRecord* scan) {
      if (i % each == each - 1) scan->T_world_lidar.t.x() += 0.5;
    };
  };
  EXPECT_EQ(VerdictOn(off_each(10)).grade, RunVerdict::Grade::kWrong);
  EXPECT_THAT(ToString(VerdictOn(off_each(10))), HasSubstr("which no vehicle makes"));
  EXPECT_EQ(VerdictOn(off_each(100)).grade, RunVerdict::Grade::kDoubtful);
  // Full braking is none; nor is a gap of seconds.
  EXPECT_EQ(VerdictOn([](int i, ScanRecord* scan) {
              const double braking_s = std::clamp(0.1 * (i - 100), 0.0, 1.25);
              if (i < 100) return;
              scan->T_world_lidar.t.x() = 100.0 + 10.0 * braking_s - 4.0 * braking_s * braking_s;
            }).grade,
            RunVerdict::Grade::kGood);
  EXPECT_EQ(VerdictOn([](int i, ScanRecord* scan) {
              if (i < 100) return;
              scan->stamp_ns += 3'000'000'000LL;
              scan->T_world_lidar.t.x() += 25.0;
            }).grade,
            RunVerdict::Grade::kGood);
}

TEST(RunVerdictTest, UnevenStepsWithoutStampsAreNoSpeeds) {
  const auto uneven = [](bool recorded) {
    return [recorded](int i, ScanRecord* scan) {
      scan->T_world_lidar.t.x() = 3.0 * i + (i % 2) * 1.5;
      scan->recorded_stamp = recorded;
    };
  };
  EXPECT_EQ(VerdictOn(uneven(true)).grade, RunVerdict::Grade::kWrong);
  EXPECT_EQ(VerdictOn(uneven(false)).grade, RunVerdict::Grade::kGood);
}

TEST(RunVerdictTest, MatchesThatDoNotConvergeAreWrong) {
  const auto share = [](int each) {
    return [each](int i, ScanRecord* scan) {
      if (i % each == 0) scan->iterations = kMaxIterations;
    };
  };
  EXPECT_EQ(VerdictOn(share(5)).grade, RunVerdict::Grade::kWrong);
  EXPECT_EQ(VerdictOn(share(10)).grade, RunVerdict::Grade::kDoubtful);
  EXPECT_EQ(VerdictOn(share(50)).grade, RunVerdict::Grade::kGood);
}

TEST(RunVerdictTest, ScansTooFarApartMatchLittle) {
  const RunVerdict verdict = VerdictOn([](int, ScanRecord* scan) { scan->inlier_share = 0.10; });
  EXPECT_EQ(verdict.grade, RunVerdict::Grade::kWrong);
  EXPECT_THAT(ToString(verdict), HasSubstr("share of inliers is 0.10"));
}

TEST(RunVerdictTest, WhatWeighsMostIsSaidFirst) {
  const RunVerdict verdict = VerdictOn([](int i, ScanRecord* scan) {
    if (i >= 40 && i < 160) scan->status = "lost";
    scan->piece = i < 160 ? 0 : 1;
    if (i % 11 == 0) scan->iterations = kMaxIterations;
  });
  EXPECT_EQ(verdict.grade, RunVerdict::Grade::kWrong);
  ASSERT_EQ(verdict.reasons.size(), 3U);
  EXPECT_THAT(verdict.reasons[0], HasSubstr("60.0 % of the scans are lost"));
  EXPECT_THAT(verdict.reasons[1], HasSubstr("did not converge"));
  EXPECT_THAT(verdict.reasons[2], HasSubstr("2 pieces"));
  EXPECT_THAT(verdict.hint, HasSubstr("frames.csv"));
}

TEST(RunVerdictTest, APieceThatIsFoundInAnEarlierOneIsConnected) {
  const auto pieces = [](bool found) {
    return VerdictOn([found](int i, ScanRecord* scan) {
      scan->sequence = i % 2 == 0 ? "a" : "b";
      scan->piece = i % 2 == 0 ? 0 : found && i >= 40 ? 0 : 1;
    });
  };
  EXPECT_EQ(pieces(true).grade, RunVerdict::Grade::kGood);
  EXPECT_EQ(pieces(false).grade, RunVerdict::Grade::kDoubtful);
}

TEST(RunVerdictTest, PosesOfDifferentPiecesAreNoMotion) {
  const RunVerdict verdict = VerdictOn([](int i, ScanRecord* scan) {
    scan->piece = i / 100;
    if (scan->piece == 1) scan->T_world_lidar.t.x() = 1e4;
  });
  EXPECT_EQ(verdict.grade, RunVerdict::Grade::kDoubtful);
  EXPECT_EQ(verdict.reasons.size(), 1U);
}

}  // namespace
}  // namespace lamina
