#include "backend/loops/submap_trimming.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "core/base/angle.h"

namespace lamina {
namespace {

// Submaps of a straight road, 30 m each with a keyframe every 2 m, driven again and again.
class SubmapTrimming : public testing::Test {
 protected:
  static constexpr double kLengthM = 30.0, kRoundM = 1000.0;

  SubmapTrimming() { options_.kept_visits = 3; }

  // A passage from `from_m` on along the road, at this distance beside it.
  void Pass(double from_m, double beside_m = 0.0, double turn_rad = 0.0) {
    Submap submap;
    submap.id = next_id_++;
    submap.way_m = kLengthM;
    for (double s = 0.0; s < kLengthM; s += 2.0) {
      const double at = s * std::cos(turn_rad), left = s * std::sin(turn_rad);
      submap.keyframes.push_back({0, 0, SE3(Eigen::Quaterniond::Identity(), {at, left, 0.0})});
    }
    anchors_.emplace_back(Eigen::Quaterniond::Identity(), Eigen::Vector3d(from_m, beside_m, 0.0));
    ways_.push_back(next_way_m_);
    next_way_m_ += kLengthM;
    submaps_.push_back(std::move(submap));
  }
  // A long way, of which the submaps were trimmed.
  void GoRound() {
    next_way_m_ += kRoundM;
    next_id_ += 30;
  }
  // Two submaps, and a long way round.
  void Round() {
    Pass(0.0);
    Pass(kLengthM);
    GoRound();
  }
  void Join(std::size_t from, std::size_t to) {
    Loop loop;
    loop.status = Loop::Status::kAccepted;
    loop.solved = true;
    loop.from = from;
    loop.to = to;
    loops_.push_back(loop);
  }
  // Rounds, each submap of which has loops with all earlier ones of its place.
  void Rounds(int rounds) {
    for (int round = 0; round < rounds; ++round) {
      Round();
      for (std::size_t to = submaps_.size() - 2; to < submaps_.size(); ++to) {
        for (std::size_t from = to % 2; from < to; from += 2) Join(from, to);
      }
    }
  }
  std::optional<DispensableSubmap> Find() const {
    return FindDispensable({submaps_, anchors_, ways_, loops_}, options_);
  }

  LoopOptions options_;
  std::vector<Submap> submaps_;
  std::vector<SE3> anchors_;
  std::vector<double> ways_;
  std::vector<Loop> loops_;
  double next_way_m_ = 0.0;
  std::int64_t next_id_ = 0;
};

TEST_F(SubmapTrimming, OfFiveVisitsTheFourthIsDispensable) {
  Rounds(5);
  const auto found = Find();
  ASSERT_TRUE(found.has_value());
  EXPECT_EQ(found->submap, 6U);
  EXPECT_EQ(found->holder, 0U);
}

TEST_F(SubmapTrimming, OfFourVisitsNoneIsAndTheOptionSaysHowMany) {
  Rounds(4);
  EXPECT_FALSE(Find().has_value());
  options_.kept_visits = 2;
  EXPECT_EQ(Find().value().submap, 4U);
}

TEST_F(SubmapTrimming, NearIsNotEnough) {
  Rounds(5);
  // The levels of a bridge: over one another, without a loop.
  loops_.clear();
  EXPECT_FALSE(Find().has_value());
}

TEST_F(SubmapTrimming, ALoopThatDoesNotCountIsNoVisit) {
  Rounds(5);
  for (Loop& loop : loops_) loop.solved = loop.from != 2 && loop.to != 2;
  EXPECT_EQ(Find().value().submap, 7U);
  for (Loop& loop : loops_) {
    loop.solved = true;
    if (loop.from == 2 || loop.to == 2) loop.status = Loop::Status::kWaiting;
  }
  EXPECT_EQ(Find().value().submap, 7U);
}

TEST_F(SubmapTrimming, WhatLeavesTheRoadStays) {
  Rounds(3);
  // Turns off to where no other visit has been.
  Pass(0.0, 0.0, 1.2);
  for (const std::size_t from : {0U, 2U, 4U}) Join(from, 6);
  GoRound();
  Pass(0.0);
  Join(6, 7);
  Pass(kLengthM);
  EXPECT_FALSE(Find().has_value());
}

TEST_F(SubmapTrimming, OtherLanesCoverAndOtherStreetsDoNot) {
  for (const double beside_m : {0.0, 4.0, 8.0, 0.0, 4.0}) {
    Pass(0.0, beside_m);
    for (std::size_t from = 0; from + 1 < submaps_.size(); ++from) Join(from, submaps_.size() - 1);
    GoRound();
  }
  Pass(0.0, 100.0);
  EXPECT_EQ(Find().value().submap, 3U);
  anchors_[1].t.y() = 40.0;
  EXPECT_FALSE(Find().has_value());
}

TEST_F(SubmapTrimming, AThirdSubmapJoinsTwoThatLieOnOneLevel) {
  for (int visit = 0; visit < 5; ++visit) {
    Pass(0.0);
    GoRound();
  }
  Pass(0.0, 100.0);
  // The fourth has a loop with the first one alone, the fifth with all.
  Join(0, 3);
  for (const std::size_t from : {0U, 1U, 2U, 3U}) Join(from, 4);
  EXPECT_EQ(Find().value().submap, 3U);
  // The second and the third are a storey above: they are not what the fourth sees.
  anchors_[1].t.z() = anchors_[2].t.z() = 2.8;
  EXPECT_FALSE(Find().has_value());
}

TEST_F(SubmapTrimming, OfASensorThatTurnsOnTheSpotTheFirstRoundsStay) {
  const auto turn = [&](double from_deg, double to_deg) {
    Pass(0.0);
    submaps_.back().way_m = 0.0;
    next_way_m_ -= kLengthM;
    submaps_.back().keyframes.clear();
    for (double deg = from_deg; deg < to_deg; deg += 10.0) {
      submaps_.back().keyframes.push_back(
          {0, 0, SE3(ExpSO3({0.0, 0.0, Radians(deg)}), Eigen::Vector3d::Zero())});
    }
  };
  for (int round = 0; round < 6; ++round) {
    EXPECT_FALSE(Find().has_value());
    turn(0.0, 360.0);
  }
  EXPECT_EQ(Find().value().submap, 3U);
  EXPECT_EQ(Find().value().holder, 0U);
  // One that others have not looked the way of stays.
  for (SubmapKeyframe& keyframe : submaps_[1].keyframes)
    keyframe.T_submap_lidar = SE3(ExpSO3({0.0, 0.0, 0.1}), Eigen::Vector3d::Zero());
  EXPECT_FALSE(Find().has_value());
}

TEST_F(SubmapTrimming, LoopsWithOnePassageAreOneVisit) {
  Rounds(2);
  // Begins in the middle between two submaps of each visit, and has loops with both.
  Pass(0.5 * kLengthM);
  for (const std::size_t from : {0U, 1U, 2U, 3U}) Join(from, 4);
  GoRound();
  Pass(0.0);
  Pass(kLengthM);
  Join(4, 5);
  Join(4, 6);
  EXPECT_FALSE(Find().has_value());
  options_.kept_visits = 2;
  EXPECT_EQ(Find().value().submap, 4U);
}

}  // namespace
}  // namespace lamina
