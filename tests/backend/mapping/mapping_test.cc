// Mapping as a program of one's own uses it: scans pushed in, one by one.
#include "backend/mapping/mapping.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <limits>
#include <map>
#include <stdexcept>

#include "backend/mapping/pipeline.h"
#include "core/base/error.h"
#include "core/base/parallel.h"
#include "tests/support/memory_scans.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {
namespace {

constexpr int kWalkScans = 24;

SE3 TruePose(int i) {
  return SE3(Eigen::Quaterniond(Eigen::AngleAxisd(0.01 * i, Eigen::Vector3d::UnitZ())),
             {0.06 * i, 0.02 * i, 0.0});
}

// Every point carries its time, as from a sensor that sweeps.
std::vector<Scan> WalkScans(unsigned seed) {
  Draws draws(seed);
  std::vector<Scan> scans;
  for (int i = 0; i < kWalkScans; ++i) {
    Scan scan;
    scan.stamp_ns = 100'000'000LL * i;
    const SE3 T_lidar_world = TruePose(i).Inverse();
    for (const Eigen::Vector3d& p : World::Room().Sample(700, 0.005, &draws)) {
      scan.points.push_back(ToScanPoint(T_lidar_world * p));
      scan.time_s.push_back(0.0F);
    }
    scans.push_back(std::move(scan));
  }
  return scans;
}

MappingOptions WalkOptions() {
  MappingOptions options;
  options.loops.enabled = false;
  options.preparation.min_range_m = 0.5;
  options.mapper.backend.window.frames = 6;
  options.mapper.backend.solve_every_keyframes = 3;
  return options;
}

// The final poses and the map, every bit of them.
struct MappedTotals {
  std::map<std::size_t, SE3> poses;
  std::string bits;
  MappingCounts counts;
};

template <typename AddScans>
MappedTotals TotalsOf(const AddScans& add_scans, const MappingOptions& options = WalkOptions()) {
  MappedTotals outcome;
  StateArchive bits;
  MappingCallbacks callbacks;
  callbacks.on_final_pose = [&](FinalPose pose) {
    outcome.poses[pose.scan] = pose.pose.T_world_lidar;
    bits(&pose.scan, &pose.pose, &pose.skipped, &pose.piece);
  };
  Mapping mapping(options, callbacks);
  add_scans(&mapping);
  mapping.Finish();
  mapping.map().ForEachSurface(
      1, [&](Surfel s) { bits(&s.centre, &s.normal, &s.eigenvalues, &s.count, &s.piece); });
  outcome.bits = bits.written();
  outcome.counts = mapping.counts();
  return outcome;
}

TEST(Mapping, IsFinishedOnce) {
  std::size_t poses = 0;
  MappingCallbacks callbacks;
  callbacks.on_final_pose = [&](const FinalPose&) { ++poses; };
  Mapping mapping(WalkOptions(), callbacks);
  const std::vector<Scan> scans = WalkScans(1);
  for (std::size_t i = 0; i < 5; ++i) mapping.Add(scans[i]);
  mapping.Finish();
  mapping.Finish();
  EXPECT_EQ(poses, 5U);
  EXPECT_THROW(mapping.Add(scans[5]), std::logic_error);
}

TEST(Mapping, GivesPosesAndAMapWithoutFilesOrThreadsOfTheCaller) {
  const std::vector<Scan> scans = WalkScans(1);
  std::vector<MappedScan> mapped;
  const MappedTotals outcome = TotalsOf([&](Mapping* mapping) {
    for (const Scan& scan : scans) mapped.push_back(mapping->Add(scan));
  });
  ASSERT_EQ(outcome.poses.size(), scans.size());
  EXPECT_STREQ(StatusName(mapped.front()), "first");
  for (int i = 0; i < kWalkScans; ++i) {
    const auto at = static_cast<std::size_t>(i);
    EXPECT_LT((outcome.poses.at(at).t - TruePose(i).t).norm(), 0.01) << i;
    EXPECT_EQ(mapped[at].index, at);
    if (i == 0) continue;
    EXPECT_STREQ(StatusName(mapped[at]), "tracked") << i;
    const Matrix6d& covariance = mapped[at].odometry.match.covariance;
    EXPECT_GT(covariance.diagonal().minCoeff(), 0.0) << i;
    EXPECT_LT((mapped[at].odometry.T_world_lidar.t - TruePose(i).t).norm(), 0.02) << i;
  }
  EXPECT_GT(outcome.counts.solves, 5U);
}

TEST(Mapping, CallsScansTrackedThatAreKnownWellEnough) {
  const std::vector<Scan> scans = WalkScans(4);
  std::vector<MappedScan> mapped;
  const auto add_scans = [&](Mapping* mapping) {
    mapped.clear();
    for (const Scan& scan : scans) mapped.push_back(mapping->Add(scan));
  };
  const MappedTotals usual = TotalsOf(add_scans);
  std::vector<double> sigmas_m;
  for (const MappedScan& scan : mapped) sigmas_m.push_back(scan.odometry.match.worst_sigma_m);
  std::sort(sigmas_m.begin(), sigmas_m.end());
  MappingOptions options = WalkOptions();
  options.mapper.frontend.max_tracked_sigma_m = sigmas_m[kWalkScans / 2];
  const MappedTotals strict = TotalsOf(add_scans, options);
  for (std::size_t i = 1; i < mapped.size(); ++i) {
    const bool known = mapped[i].odometry.match.worst_sigma_m <= sigmas_m[kWalkScans / 2];
    EXPECT_STREQ(StatusName(mapped[i]), known ? "tracked" : "degenerate") << i;
  }
  EXPECT_EQ(usual.counts.degenerate, 0U);
  EXPECT_EQ(strict.counts.degenerate, kWalkScans / 2 - 1U);
  // What they are called is all that differs.
  EXPECT_TRUE(strict.bits == usual.bits);
}

TEST(Mapping, HasTheSameBitsAsThePipelineAtAnyNumberOfThreads) {
  const std::vector<Scan> scans = WalkScans(2);
  const MappedTotals one_by_one = TotalsOf([&](Mapping* mapping) {
    for (const Scan& scan : scans) mapping->Add(scan);
  });
  for (const std::size_t threads : {1U, 3U}) {
    const ThreadLimit limit(threads);
    const MappedTotals piped = TotalsOf([&](Mapping* mapping) {
      EXPECT_EQ(MapScans(MemoryScans(scans), {0, 0, scans.size()}, mapping), scans.size());
    });
    EXPECT_TRUE(piped.bits == one_by_one.bits) << threads << " threads";
  }
}

TEST(Mapping, SkipsWhatItCannotUseAndGoesOn) {
  const std::vector<Scan> scans = WalkScans(3);
  const MappedTotals outcome = TotalsOf([&](Mapping* mapping) {
    for (int i = 0; i < kWalkScans; ++i) {
      const Scan& scan = scans[static_cast<std::size_t>(i)];
      EXPECT_FALSE(mapping->Add(scan).skipped) << i;
      if (i != 10) continue;
      const MappedScan again = mapping->Add(scan);
      EXPECT_TRUE(again.skipped);
      EXPECT_EQ(again.reason, SkipReason::kStampNotAfterLast);
      Scan hollow = scan;
      hollow.stamp_ns += 1;
      for (ScanPoint& p : hollow.points) p.x = std::numeric_limits<float>::quiet_NaN();
      const MappedScan empty = mapping->Add(hollow);
      EXPECT_EQ(empty.reason, SkipReason::kTooFewPoints);
      EXPECT_THAT(empty.detail, testing::HasSubstr("scan 12"));
      EXPECT_EQ(empty.points, 0U);
      EXPECT_TRUE(mapping->Add(Scan()).skipped);
    }
  });
  EXPECT_EQ(outcome.counts.scans, scans.size() + 3);
  EXPECT_EQ(outcome.counts.frames, scans.size());
  EXPECT_EQ(outcome.counts.lost, 0U);
  EXPECT_LT((outcome.poses.rbegin()->second.t - TruePose(kWalkScans - 1).t).norm(), 0.01);
}

// As after one stamp far ahead of all others, too.
TEST(Mapping, AClockThatIsSetBackBeginsAPiece) {
  std::vector<Scan> scans = WalkScans(3);
  scans[4].stamp_ns += 1'000'000'000'000;
  const MappedTotals outcome = TotalsOf([&](Mapping* mapping) {
    for (int i = 0; i < kWalkScans; ++i) {
      const MappedScan scan = mapping->Add(scans[static_cast<std::size_t>(i)]);
      EXPECT_EQ(scan.skipped, i > 4 && i < 15) << i;
      EXPECT_EQ(scan.began_piece, i == 0 || i == 15) << i;
      EXPECT_EQ(scan.piece, i < 15 ? 0 : 1) << i;
    }
  });
  EXPECT_EQ(outcome.counts.pieces, 2U);
  EXPECT_EQ(outcome.counts.lost, 0U);
  const SE3 moved = outcome.poses.at(15).Inverse() * outcome.poses.at(kWalkScans - 1);
  EXPECT_LT((moved.t - (TruePose(15).Inverse() * TruePose(kWalkScans - 1)).t).norm(), 0.01);
}

// Files that come late, in no order, are no new clock.
TEST(Mapping, LateScansBeginNoPiece) {
  const std::vector<Scan> scans = WalkScans(3);
  const MappedTotals outcome = TotalsOf([&](Mapping* mapping) {
    for (const Scan& scan : scans) mapping->Add(scan);
    for (int i = kWalkScans; i-- > 0;)
      EXPECT_TRUE(mapping->Add(scans[static_cast<std::size_t>(i)]).skipped);
  });
  EXPECT_EQ(outcome.counts.pieces, 1U);
}

TEST(Mapping, SkipsScansWhoseTimesAreNoneOfASweep) {
  std::vector<Scan> scans = WalkScans(3);
  for (Scan& scan : scans) {
    for (std::size_t k = 0; k < scan.time_s.size(); ++k) {
      scan.time_s[k] = 0.05F * static_cast<float>(k) / static_cast<float>(scan.time_s.size());
    }
  }
  const auto with_times = [](Scan scan, float factor, float shift) {
    for (float& t : scan.time_s) t = factor * t + shift;
    return scan;
  };
  const auto expect_refused = [](const MappedScan& mapped, const char* why) {
    EXPECT_TRUE(mapped.skipped);
    EXPECT_EQ(mapped.reason, SkipReason::kUnreadable);
    EXPECT_THAT(mapped.detail, testing::HasSubstr(why));
  };
  Mapping mapping(WalkOptions());
  // In ms, and readings of a clock: of the first scan, and of others.
  expect_refused(mapping.Add(with_times(scans[0], 1000.0F, 0.0F)), "no sweep lasts so long");
  expect_refused(mapping.Add(with_times(scans[1], 1.0F, 5000.0F)), "from its stamp");
  EXPECT_FALSE(mapping.Add(scans[2]).skipped);
  expect_refused(mapping.Add(with_times(scans[3], 1000.0F, 0.0F)), "scans are 0.1 s apart");
  expect_refused(mapping.Add(with_times(scans[4], 1.0F, -70.0F)), "from its stamp");
  // Single times may be damaged; a sweep may end at its stamp.
  Scan some = with_times(scans[5], 1.0F, -0.05F);
  some.time_s[7] = 1e9F;
  some.time_s[9] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(mapping.Add(some).skipped);
  EXPECT_EQ(mapping.counts().skipped.at(SkipReason::kUnreadable), 4U);
}

TEST(Mapping, RecordingsThatAlternateArePiecesOfTheirOwn) {
  const std::vector<Scan> a = WalkScans(4), b = WalkScans(5);
  std::map<std::string, std::vector<SE3>> alone, mixed;
  const auto add = [](Mapping* mapping, const Scan& scan, const std::string& name,
                      std::map<std::string, std::vector<SE3>>* poses) {
    const MappedScan mapped = mapping->Add(scan, name);
    (*poses)[name].push_back(mapped.odometry.T_world_lidar);
    return mapped.piece;
  };
  TotalsOf([&](Mapping* mapping) {
    for (const Scan& scan : a) add(mapping, scan, "a", &alone);
  });
  TotalsOf([&](Mapping* mapping) {
    for (const Scan& scan : b) add(mapping, scan, "b", &alone);
  });
  TotalsOf([&](Mapping* mapping) {
    for (std::size_t i = 0; i < a.size(); ++i) {
      EXPECT_EQ(add(mapping, a[i], "a", &mixed), 0);
      EXPECT_EQ(add(mapping, b[i], "b", &mixed), 1);
    }
  });
  // Alone and mixed, a recording's poses begin at the origin and differ by what voxels cut.
  for (const char* name : {"a", "b"}) {
    for (std::size_t i = 0; i < a.size(); ++i) {
      EXPECT_LT((alone[name][i].t - mixed[name][i].t).norm(), 1e-3) << name << i;
    }
  }
}

TEST(Mapping, RefusesWhatNoCallerShouldHandIn) {
  Mapping mapping(WalkOptions());
  Scan scan = WalkScans(6).front();
  scan.time_s.pop_back();
  EXPECT_THROW(mapping.Add(scan), std::logic_error);
  EXPECT_EQ(mapping.counts().scans, 0U);
  mapping.Finish();
  EXPECT_THROW(mapping.Add(WalkScans(6).front()), std::logic_error);
}

TEST(Mapping, RefusesOptionsOutOfRange) {
  MappingOptions options;
  options.preparation.min_range_m = -1.0;
  EXPECT_THROW(Mapping{options}, OptionError);
  options = {};
  options.pipeline.min_points = 0;
  EXPECT_THROW(Mapping{options}, OptionError);
}

}  // namespace
}  // namespace lamina
