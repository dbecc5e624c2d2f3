#include "backend/places/place_lookup.h"

#include <gtest/gtest.h>

#include <vector>

#include "backend/submaps/submap_registration.h"
#include "core/base/angle.h"
#include "tests/support/scenes/submap_town.h"

namespace lamina {
namespace {

constexpr double kLookupLeafM = 0.8;

VoxelMapOptions MapOptions() {
  VoxelMapOptions options;
  options.root_size_m = 1.6;
  options.depth = 1;
  return options;
}

// One submap of a drive whose LiDAR is turned by `tilt` on the vehicle.
Submap SubmapOf(const Town& town, const std::vector<SE3>& drive, const SE3& tilt, Draws* draws) {
  SubmapOptions options;
  options.length_m = 1000.0;
  SubmapBuilder builder(options, kLookupLeafM);
  std::int64_t id = 0;
  for (const SE3& T : drive) {
    const SE3 T_lidar = T * tilt;
    builder.Add(KeyframeOf(town, id++, T_lidar, T_lidar, kLookupLeafM, draws));
  }
  return *builder.Finish();
}

struct Described {
  Submap submap;
  PlaceImage image;
  SubmapQuery query;
};

Described Describe(Submap submap) {
  Described described;
  std::vector<LeafPlane> planes = LeafPlanes(submap);
  described.image = MakePlaceImage(submap, planes, PlaceOptions(), Eigen::Vector3d::UnitZ());
  described.query =
      MakeQuery(submap, std::move(planes),
                described.image.T_level_submap.q.conjugate() * Eigen::Vector3d::UnitZ());
  described.submap = std::move(submap);
  return described;
}

// How far the middle of the query lies off, and by how much it is turned.
double OffM(const SE3& T, const SE3& truth, const Described& query) {
  const Eigen::Vector3d middle = query.image.T_level_submap.Inverse().t;
  return (T * middle - truth * middle).norm();
}

class PlaceLookup : public testing::Test {
 protected:
  PlaceLookup() : draws(7), town(1) {
    // Eight streets; the first one is visited again.
    for (const double at : {0.0, 60.0, -60.0, 120.0}) {
      places.push_back(Describe(SubmapOf(town, Drive({{at, -20.0}, {at, 10.0}}), SE3(), &draws)));
      places.push_back(Describe(SubmapOf(town, Drive({{-20.0, at}, {10.0, at}}), SE3(), &draws)));
    }
    for (const Described& place : places) images.push_back(&place.image);
  }
  SE3 Truth(const Described& query, std::size_t other) const {
    return places[other].submap.T_world_submap.Inverse() * query.submap.T_world_submap;
  }

  Draws draws;
  Town town;
  std::vector<Described> places;
  std::vector<const PlaceImage*> images;
};

TEST_F(PlaceLookup, FindsTheStreetAgainInBothDirectionsAndWithATiltedSensor) {
  const SE3 tilted(ExpSO3({0.15, -0.2, 0.4}), {0, 0, 0.3});
  const std::vector<Described> queries = {
      Describe(SubmapOf(town, Drive({{1.0, -24.0}, {1.0, 6.0}}), SE3(), &draws)),
      Describe(SubmapOf(town, Drive({{-1.0, 15.0}, {-1.0, -15.0}}), SE3(), &draws)),
      Describe(SubmapOf(town, Drive({{0.5, 14.0}, {0.5, -16.0}}), tilted, &draws))};
  for (const Described& query : queries) {
    const std::vector<PlaceHypothesis> found = LookUpPlace(query.image, images, PlaceOptions());
    ASSERT_FALSE(found.empty());
    EXPECT_EQ(found[0].other, 0U);
    const SE3 truth = Truth(query, 0);
    EXPECT_LT(OffM(found[0].T_other_query, truth, query), 2.0);
    EXPECT_LT(RotationAngle(found[0].T_other_query, truth), 6.0 * kDegree);

    const SubmapTarget target(places[0].submap, MapOptions());
    const SubmapMatch match = SubmapRegistration(ScanMatcherOptions())
                                  .Register(query.query, target, found[0].T_other_query);
    EXPECT_EQ(Refusal(match, VerificationOptions()), "");
    EXPECT_LT(OffM(match.T_other_query, truth, query), 0.03);
    EXPECT_LT(RotationAngle(match.T_other_query, truth), 0.1 * kDegree);
  }
}

TEST_F(PlaceLookup, AnotherTownIsRefused) {
  const Town elsewhere(2);
  const Described query =
      Describe(SubmapOf(elsewhere, Drive({{0.0, -20.0}, {0.0, 10.0}}), SE3(), &draws));
  for (const PlaceHypothesis& found : LookUpPlace(query.image, images, PlaceOptions())) {
    const SubmapTarget target(places[found.other].submap, MapOptions());
    const SubmapMatch match =
        SubmapRegistration(ScanMatcherOptions()).Register(query.query, target, found.T_other_query);
    EXPECT_NE(Refusal(match, VerificationOptions()), "");
  }
}

TEST_F(PlaceLookup, HypothesesDoNotDependOnTheNumberOfThreads) {
  const Described query =
      Describe(SubmapOf(town, Drive({{1.0, -24.0}, {1.0, 6.0}}), SE3(), &draws));
  const auto all = LookUpPlace(query.image, images, PlaceOptions());
  const ThreadLimit one(1);
  const auto alone = LookUpPlace(query.image, images, PlaceOptions());
  ASSERT_EQ(all.size(), alone.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    EXPECT_EQ(all[i].other, alone[i].other);
    EXPECT_EQ(all[i].score, alone[i].score);
    EXPECT_EQ(all[i].T_other_query.t, alone[i].T_other_query.t);
  }
}

TEST(SubmapRegistration, ACorridorIsOpenAlongItself) {
  Draws draws(4);
  const World corridor = World::Corridor();
  const auto build = [&](double at) {
    SubmapBuilder builder({}, 0.5);
    for (int i = 0; i < 5; ++i) {
      const SE3 T(Eigen::Quaterniond::Identity(), {at + i, 0, 0});
      FinalKeyframe keyframe{i, i, T, {}};
      for (const PointCluster& c : Untimed(ScanFrom(T, corridor.Sample(3000, 0.01, &draws), 0.5)))
        keyframe.clusters.push_back(c.Moved(T));
      builder.Add(keyframe);
    }
    return Describe(*builder.Finish());
  };
  const Described a = build(0.0), b = build(3.0);
  const SubmapTarget target(a.submap, MapOptions());
  const SubmapMatch match =
      SubmapRegistration(ScanMatcherOptions())
          .Register(b.query, target, SE3(Eigen::Quaterniond::Identity(), {5.0, 0.0, 0.0}));
  EXPECT_GT(match.overlap, 0.8);
  EXPECT_EQ(Refusal(match, VerificationOptions()), "open along a horizontal direction");
}

TEST(LevelFrame, UpIsFoundFromFloorAndWalls) {
  Draws draws(9);
  const World room = World::Room();
  const SE3 tilt(ExpSO3({0.3, -0.25, 0.0}), {0, 0, 0});
  SubmapBuilder builder({}, 0.5);
  FinalKeyframe keyframe{0, 0, SE3(), {}};
  for (const PointCluster& c : Untimed(ScanFrom(tilt, room.Sample(20000, 0.01, &draws), 0.5)))
    keyframe.clusters.push_back(c);
  builder.Add(keyframe);
  const Eigen::Vector3d up =
      UpOfPlanes(LeafPlanes(*builder.Finish()), Eigen::Vector3d::UnitZ(), 35.0);
  EXPECT_LT(std::acos(up.dot(tilt.q.conjugate() * Eigen::Vector3d::UnitZ())), 0.5 * kDegree);
  EXPECT_EQ(UpOfPlanes({}, Eigen::Vector3d::UnitX(), 35.0), Eigen::Vector3d::UnitX());
}

}  // namespace
}  // namespace lamina
