#include "backend/localisation/place_index.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "backend/localisation/place_search.h"
#include "core/base/angle.h"
#include "tests/support/memory_voxel_store.h"
#include "tests/support/scenes/mapped_drives.h"

namespace lamina {
namespace {

// A finished map of one drive, and its places.
class PlaceIndexTest : public testing::Test {
 protected:
  void MapTown(const Town& town, const std::vector<SE3>& drive, StampNs start_ns = 0) {
    mapped_ = MapDrive(town, drive, 3, 0.0, start_ns);
    map_ = std::make_unique<VoxelMap>(VoxelMapOptions());
    AddToMap(mapped_.loops->submaps(), mapped_.loops->anchors(), map_.get());
    std::vector<Eigen::Vector3d> way;
    for (const StampedPose& pose : mapped_.odometry) way.push_back(pose.T_world_lidar.t);
    std::vector<MapPlace> places;
    AddPlaces(0, way, PlaceIndex::SpacingM(options_), &places);
    index_ = std::make_unique<PlaceIndex>(options_, ScanMatcherOptions(), places, *map_);
  }
  // Looks after every fourth keyframe of a visit, whose own world is the frame of its first pose
  // and turns by so much with each keyframe.
  std::optional<FoundPlace> Visit(const Town& town, const std::vector<SE3>& drive, unsigned seed,
                                  double bend_deg = 0.0) {
    constexpr std::size_t kWindow = 4;
    const SE3 bend(ExpSO3({0.0, 0.0, Radians(bend_deg)}), Eigen::Vector3d::Zero());
    Draws draws(seed);
    PlaceSearch search(options_, map_->options().LeafSize());
    std::vector<FinalKeyframe> window;
    T_own_newest_ = SE3();
    for (std::size_t i = 0; i < drive.size(); ++i) {
      if (i > 0) T_own_newest_ = T_own_newest_ * bend * drive[i - 1].Inverse() * drive[i];
      T_true_newest_ = drive[i];
      window.push_back(KeyframeOf(town, static_cast<std::int64_t>(i), drive[i], T_own_newest_,
                                  map_->options().LeafSize(), &draws, range_m_));
      if (window.size() > kWindow) {
        search.Add(window.front());
        window.erase(window.begin());
      }
      if (i % 4 != 3) continue;
      if (const auto found = search.Look(search.BeginLook(window), *index_, *map_)) return found;
      reasons_ += search.reason() + "; ";
    }
    return std::nullopt;
  }
  // Of the newest pose of the last visit.
  SE3 Error(const FoundPlace& found) const {
    return (mapped_.truth[0].Inverse() * T_true_newest_).Inverse() * found.T_piece_own *
           T_own_newest_;
  }
  double ErrorM(const FoundPlace& found) const { return Error(found).t.norm(); }

  LoopOptions options_ = DriveLoopOptions();
  std::string reasons_;               // of all looks that were not believed
  double range_m_ = 35.0;             // of the sensor on a visit
  SE3 T_own_newest_, T_true_newest_;  // of a visit
  MappedDrive mapped_;
  std::unique_ptr<VoxelMap> map_;
  std::unique_ptr<PlaceIndex> index_;
};

TEST_F(PlaceIndexTest, AVisitIsFoundInTheMapWhateverItsDirection) {
  const Town town(1);
  MapTown(town, Drive({{-60, -60}, {60, -60}, {60, 60}}));
  const std::vector<std::vector<SE3>> visits = {
      Drive({{-20, -60}, {40, -60}}), Drive({{40, -60}, {-20, -60}}), Drive({{60, 50}, {60, -10}})};
  for (std::size_t i = 0; i < visits.size(); ++i) {
    const auto found = Visit(town, visits[i], static_cast<unsigned>(i) + 10);
    ASSERT_TRUE(found.has_value()) << "visit " << i << ": " << reasons_;
    EXPECT_LT(ErrorM(*found), 0.1) << "visit " << i;
  }
}

TEST_F(PlaceIndexTest, ScansThatSeeFartherThanAPlaceReachesAreFound) {
  options_.place.cell_size_m = 0.75;  // a place reaches 42 m
  range_m_ = 60.0;
  const Town town(1);
  MapTown(town, Drive({{-60, -60}, {60, -60}, {60, 60}}));
  const auto found = Visit(town, Drive({{-20, -60}, {40, -60}}), 10);
  ASSERT_TRUE(found.has_value()) << reasons_;
  EXPECT_LT(ErrorM(*found), 0.1);
}

TEST_F(PlaceIndexTest, WhereTheOwnPieceIsBentTheNewestScanSaysWhereTheSensorIs) {
  const Town town(1);
  MapTown(town, Drive({{-60, -60}, {60, -60}, {60, 60}}));
  const auto found = Visit(town, Drive({{-20, -60}, {60, -60}, {60, 0}}), 10, 0.4);
  ASSERT_TRUE(found.has_value()) << reasons_;
  EXPECT_LT(ErrorM(*found), 0.1);
  EXPECT_LT(Degrees(RotationAngle(Error(*found), SE3())), 0.1);
}

TEST_F(PlaceIndexTest, WhatTheMapDoesNotHaveIsNotFoundInIt) {
  MapTown(Town(1), Drive({{-60, -60}, {60, -60}, {60, 60}}));
  for (unsigned seed = 20; seed < 23; ++seed)
    EXPECT_FALSE(Visit(Town(seed), Drive({{-60, -60}, {60, -60}}), seed).has_value()) << seed;
  // Nor another street of the same town.
  EXPECT_FALSE(Visit(Town(1), Drive({{-60, 60}, {-60, 0}}), 30).has_value());
}

TEST_F(PlaceIndexTest, AmongEqualHousesNoneIsBelieved) {
  // A street of equal houses, 12 m from one to the next, on both sides.
  std::vector<Facet> facets;
  for (double x = -140.0; x < 140.0; x += 10.0) {
    for (double y = -20.0; y < 20.0; y += 10.0)
      facets.push_back({{x + 5, y + 5, 0}, {5, 0, 0}, {0, 5, 0}});
  }
  for (double x = -138.0; x < 138.0; x += 12.0) {
    for (const double side : {-1.0, 1.0}) {
      facets.push_back({{x, side * 8.0, 3.0}, {4, 0, 0}, {0, 0, 3}});
      facets.push_back({{x + 4, side * 11.0, 3.0}, {0, 3, 0}, {0, 0, 3}});
      facets.push_back({{x - 4, side * 11.0, 3.0}, {0, 3, 0}, {0, 0, 3}});
    }
  }
  const Town terrace(facets);
  MapTown(terrace, Drive({{-90, 0}, {90, 0}}));
  EXPECT_FALSE(Visit(terrace, Drive({{-42, 0}, {42, 0}}), 5).has_value());
}

// Walls of 3 m, no two alike.
Town Storey(unsigned seed) {
  Draws draws(seed);
  std::vector<Facet> facets;
  for (double x = -100.0; x < 100.0; x += 10.0) {
    for (double y = -100.0; y < 0.0; y += 10.0) {
      facets.push_back({{x + 5, y + 5, 0}, {5, 0, 0}, {0, 5, 0}});
      if (std::abs(y + 60.0) < 6.0) continue;
      const double angle = draws.Uniform(0.0, M_PI), half_m = draws.Uniform(1.5, 4.0);
      facets.push_back({{x + draws.Uniform(2, 8), y + draws.Uniform(2, 8), 1.5},
                        half_m * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0),
                        {0, 0, 1.5}});
    }
  }
  return Town(facets);
}

TEST_F(PlaceIndexTest, AmongEqualStoreysNoneIsBelieved) {
  // What the first storey has, the second has 4 m above; no sensor sees both.
  const Town town = Storey(3);
  const std::vector<SE3> drive = Drive({{-60, -60}, {60, -60}});
  constexpr double kStoreyM = 4.0;
  map_ = std::make_unique<VoxelMap>(VoxelMapOptions());
  std::vector<MapPlace> places;
  for (int storey = 0; storey < 2; ++storey) {
    Draws draws(static_cast<unsigned>(storey) + 1);
    SubmapBuilder builder({1e4, 1000}, map_->options().LeafSize());
    std::vector<Eigen::Vector3d> way;
    for (std::size_t i = 0; i < drive.size(); ++i) {
      SE3 T = drive[0].Inverse() * drive[i];
      T.t.z() += kStoreyM * storey;
      builder.Add(KeyframeOf(town, static_cast<std::int64_t>(i), drive[i], T,
                             map_->options().LeafSize(), &draws));
      way.push_back(T.t);
    }
    const Submap all = builder.Current();
    AddToMap(all, all.T_world_submap, map_.get());
    AddPlaces(0, way, PlaceIndex::SpacingM(options_), &places);
  }
  index_ = std::make_unique<PlaceIndex>(options_, ScanMatcherOptions(), places, *map_);
  EXPECT_FALSE(Visit(town, Drive({{-30, -60}, {30, -60}}), 7).has_value());
  EXPECT_NE(reasons_.find("others fit as well"), std::string::npos) << reasons_;
}

// Pieces of one recording, which nothing has joined yet.
class PieceIndexTest : public PlaceIndexTest {
 protected:
  void AddPiece(const Town& town, const std::vector<SE3>& drive, unsigned seed) {
    pieces_.push_back(MapDrive(town, drive, seed, 0.0));
    source_[static_cast<std::int64_t>(pieces_.size()) - 1] = pieces_.back().loops.get();
    index_ =
        std::make_unique<PlaceIndex>(options_, ScanMatcherOptions(), source_, VoxelMapOptions());
  }
  // What a short drive has gathered, looked for by all of its keyframes.
  std::vector<Sighting> Look(const Town& town, const std::vector<SE3>& drive, unsigned seed) {
    constexpr std::size_t kLast = 4;
    Draws draws(seed);
    const double leaf_m = VoxelMapOptions().LeafSize();
    SubmapBuilder builder({1e4, 1000}, leaf_m);
    std::vector<FinalKeyframe> last;
    for (std::size_t i = 0; i < drive.size(); ++i) {
      last.push_back(KeyframeOf(town, static_cast<std::int64_t>(i), drive[i],
                                drive[0].Inverse() * drive[i], leaf_m, &draws, range_m_));
      builder.Add(last.back());
      if (last.size() > kLast) last.erase(last.begin());
    }
    return index_->Find(builder.Current(), last,
                        PlaceSource(source_, VoxelMapOptions(), ambiguous_));
  }

  std::vector<MappedDrive> pieces_;
  PlaceSource::Pieces source_;
  std::set<std::int64_t> ambiguous_;
};

TEST_F(PieceIndexTest, PiecesOfOnePlaceAreNoRivals) {
  const Town town(1);
  AddPiece(town, Drive({{-60, -60}, {60, -60}, {60, 60}}), 3);
  AddPiece(town, Drive({{50, -60}, {-50, -60}}), 4);
  const std::vector<SE3> visit = Drive({{-20, -60}, {10, -60}});
  const std::vector<Sighting> sightings = Look(town, visit, 10);
  const Sighting& best = sightings.front();
  EXPECT_EQ(best.reason, "");
  std::set<std::int64_t> pieces = {best.piece};
  for (const Sighting& sighting : sightings) {
    if (!sighting.same_as_best) continue;
    pieces.insert(sighting.piece);
    const SE3 expected =
        pieces_[static_cast<std::size_t>(sighting.piece)].truth[0].Inverse() * visit[0];
    EXPECT_LT((sighting.T_piece_submap.t - expected.t).norm(), 0.1) << sighting.piece;
  }
  EXPECT_EQ(pieces.size(), 2U);
}

TEST_F(PieceIndexTest, APieceWhoseOwnPlaceIsNotSureIsARival) {
  const Town town(1);
  AddPiece(town, Drive({{-60, -60}, {60, -60}, {60, 60}}), 3);
  AddPiece(town, Drive({{50, -60}, {-50, -60}}), 4);
  ambiguous_ = {1};
  EXPECT_EQ(Look(town, Drive({{-20, -60}, {10, -60}}), 10).front().reason, "others fit as well");
}

TEST_F(PieceIndexTest, InAPieceWhoseOwnPlaceIsNotSureNothingIsBelieved) {
  const Town town(1);
  AddPiece(town, Drive({{-60, -60}, {60, -60}}), 3);
  const std::vector<SE3> visit = Drive({{-20, -60}, {10, -60}});
  EXPECT_EQ(Look(town, visit, 10).front().reason, "");
  ambiguous_ = {0};
  EXPECT_EQ(Look(town, visit, 10).front().reason, "what is there fits elsewhere as well");
}

TEST(Sightings, TwoPosesOfOnePieceAreNeverTheSame) {
  Sighting best;
  best.match.met_planes = true;
  best.met = 1.0;
  Sighting first = best;
  first.piece = 1;
  first.same_as_best = true;
  Sighting second = first;
  second.T_piece_submap.t.z() = 3.0;
  EXPECT_TRUE(NoRival({best, first}));
  EXPECT_EQ(Repeats({best, first}), false);
  EXPECT_FALSE(NoRival({best, first, second}));
  EXPECT_EQ(Repeats({best, first, second}), true);
  // What does not meet the map says nothing.
  best.met = 0.5;
  EXPECT_EQ(Repeats({best, first, second}), std::nullopt);
}

// A street along x of houses that are the same in all, and behind them others.
Town StreetWithOthersBehind(unsigned behind) {
  std::vector<Facet> facets;
  for (double x = -140.0; x < 140.0; x += 10.0) {
    for (double y = -40.0; y < 40.0; y += 10.0)
      facets.push_back({{x + 5, y + 5, 0}, {5, 0, 0}, {0, 5, 0}});
  }
  const auto add_row = [&](double from_m, double to_m, double side, Draws* draws) {
    for (double x = -138.0; x < 138.0; x += 11.0) {
      const double y = side * draws->Uniform(from_m, to_m), half = draws->Uniform(1.5, 3.5);
      const double at = x + draws->Uniform(0.0, 4.0), height = draws->Uniform(1.5, 3.0);
      facets.push_back({{at, y, height}, {half, 0, 0}, {0, 0, height}});
      facets.push_back({{at + half, y + 2 * side, height}, {0, 2, 0}, {0, 0, height}});
      facets.push_back({{at - half, y + 2 * side, height}, {0, 2, 0}, {0, 0, height}});
    }
  };
  Draws same(1), other(behind);
  for (const double side : {-1.0, 1.0}) {
    add_row(6.0, 9.0, side, &same);
    add_row(20.0, 26.0, side, &other);
  }
  return Town(facets);
}

TEST_F(PieceIndexTest, APieceThatIsAnotherPlaceIsARivalThoughTheSensorSeesNoDifference) {
  range_m_ = 16.0;
  const std::vector<SE3> way = Drive({{-60, 0}, {60, 0}}), visit = Drive({{-20, 0}, {10, 0}});
  const Town first = StreetWithOthersBehind(2), second = StreetWithOthersBehind(3);
  AddPiece(first, way, 3);
  EXPECT_EQ(Look(first, visit, 10).front().reason, "");
  AddPiece(second, way, 4);
  EXPECT_EQ(Look(first, visit, 10).front().reason, "others fit as well");
  // Where behind the houses there is the same as well, the two are one place.
  pieces_.pop_back();
  AddPiece(first, way, 4);
  EXPECT_EQ(Look(first, visit, 10).front().reason, "");
}

TEST_F(PlaceIndexTest, PlacesAreTheSameInMemoryAndInTheStore) {
  const Town town(2);
  MapTown(town, Drive({{-60, -60}, {60, -60}}));
  MapPlace place{0, {40.0, 3.0, 0.0}};
  const Submap all = SubmapAround(place, 30.0, *map_);
  ASSERT_GT(all.leaves.size(), 1000U);
  EXPECT_TRUE(SubmapAround({0, {900.0, 0.0, 0.0}}, 30.0, *map_).leaves.empty());
  MemoryVoxelStore store;
  VoxelMapOptions small;
  small.budget_mb = 1.0;
  VoxelMap map(small, &store);
  AddToMap(mapped_.loops->submaps(), mapped_.loops->anchors(), &map);
  ASSERT_FALSE(store.Empty());
  const Submap stored = SubmapAround(place, 30.0, map);
  ASSERT_EQ(stored.leaves.size(), all.leaves.size());
  for (std::size_t i = 0; i < all.leaves.size(); ++i) {
    ASSERT_TRUE(std::equal(all.leaves[i].index, all.leaves[i].index + 3, stored.leaves[i].index));
    ASSERT_EQ(all.leaves[i].cluster.count, stored.leaves[i].cluster.count);
  }
}

}  // namespace
}  // namespace lamina
