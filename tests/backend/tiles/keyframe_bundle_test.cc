#include "backend/tiles/keyframe_bundle.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "backend/bundle/plane_geometry.h"
#include "backend/bundle/solver/adjuster.h"
#include "backend/tiles/tiled_model.h"
#include "tests/support/memory_byte_store.h"
#include "tests/support/parts.h"
#include "tests/support/scenes/submap_town.h"

namespace lamina {
namespace {

std::unique_ptr<ByteStore> InMemory() { return std::make_unique<MemoryByteStore>(); }

// Two drives through the same streets, on either side of them, whose keyframes are off a little.
struct Driven final : public KeyframeSource {
  std::vector<std::vector<PackedCluster>> keyframes;
  std::vector<SE3> truth;
  BundleProblem ties;

  explicit Driven(unsigned seed) {
    const Town town(seed);
    Draws draws(seed + 1);
    truth = Drive({{-60, -60}, {0, -60}, {0, 0}});
    for (const SE3& T : Drive({{-58, -62}, {2, -62}, {2, 0}})) truth.push_back(T);
    for (std::size_t k = 0; k < truth.size(); ++k) {
      const FinalKeyframe keyframe =
          KeyframeOf(town, static_cast<std::int64_t>(k), truth[k], SE3(), 0.8, &draws, 30.0);
      keyframes.emplace_back();
      for (const PointCluster& cluster : keyframe.clusters)
        keyframes.back().push_back(PackedCluster::Of(cluster, Eigen::Vector3d::Zero()));
      const SE3 off = k == 0 ? SE3() : draws.Offset(0.004, 0.04);
      ties.poses.push_back(truth[k] * off);
      if (k == 0) continue;
      RelativePrior prior;
      prior.a = static_cast<int>(k) - 1;
      prior.b = static_cast<int>(k);
      prior.T_a_b = ties.poses[k - 1].Inverse() * ties.poses[k];
      prior.sqrt_information = 10.0 * Matrix6d::Identity();
      ties.priors.push_back(prior);
    }
  }
  std::size_t size() const override { return keyframes.size(); }
  std::vector<PackedCluster> Read(std::size_t keyframe) const override {
    return keyframes[keyframe];
  }
  double Error(const std::vector<SE3>& poses) const {
    double sum = 0.0;
    for (std::size_t k = 0; k < poses.size(); ++k) sum += (poses[k].t - truth[k].t).squaredNorm();
    return std::sqrt(sum / static_cast<double>(poses.size()));
  }
};

const Driven& Drives() {
  static const Driven driven(5);
  return driven;
}

KeyframeBundleResult Adjusted(const WorkSharing& sharing, int most_observations = 0) {
  KeyframeBundleOptions options;
  options.most_observations = most_observations;
  return AdjustKeyframes(Drives(), Drives().ties, options, VoxelMapOptions(),
                         SlidingWindowOptions(), sharing, InMemory);
}

TEST(KeyframeBundle, BringsKeyframesToWhereTheyWere) {
  const Driven& driven = Drives();
  const KeyframeBundleResult result = Adjusted({});
  EXPECT_EQ(result.refusal, "");
  EXPECT_LT(driven.Error(result.poses), 0.3 * driven.Error(driven.ties.poses));
  EXPECT_LT(result.final_misfit_m, result.initial_misfit_m);
  EXPECT_GT(result.tiles, 4U);
  ASSERT_GE(result.rounds.size(), 2U);
  for (const KeyframeRound& round : result.rounds) EXPECT_LT(round.final_cost, round.initial_cost);
  EXPECT_EQ(result.poses[0].t, driven.ties.poses[0].t);
  // Summed with their neighbours, observations say nearly as much.
  const KeyframeBundleResult summed = Adjusted({}, 6);
  EXPECT_LT(summed.rounds[0].observations, result.rounds[0].observations);
  EXPECT_LT(summed.rounds[0].blocks, result.rounds[0].blocks);
  EXPECT_LT(driven.Error(summed.poses), 0.4 * driven.Error(driven.ties.poses));
}

TEST(KeyframeBundle, IsTheSameInAnyNumberOfParts) {
  const KeyframeBundleResult alone = Adjusted({});
  for (const std::size_t parts : {2U, 3U}) {
    std::vector<KeyframeBundleResult> results(parts);
    InParts(parts, [&](const WorkSharing& sharing) { results[sharing.part] = Adjusted(sharing); });
    for (const KeyframeBundleResult& result : results) {
      ASSERT_EQ(result.rounds.size(), alone.rounds.size());
      EXPECT_EQ(result.rounds.back().final_cost, alone.rounds.back().final_cost);
      EXPECT_EQ(result.final_misfit_m, alone.final_misfit_m);
      for (std::size_t k = 0; k < alone.poses.size(); ++k) {
        EXPECT_EQ(result.poses[k].t, alone.poses[k].t);
        EXPECT_EQ(result.poses[k].q.coeffs(), alone.poses[k].q.coeffs());
      }
    }
    EXPECT_GT(results[0].rounds[0].bytes_received, 0U);
  }
}

TEST(KeyframeBundle, NoMapNoMove) {
  BundleProblem ties = Drives().ties;
  for (std::size_t k = 0; k < ties.poses.size(); ++k)
    ties.poses[k].t.x() += 1000.0 * static_cast<double>(k);
  const KeyframeBundleResult result =
      AdjustKeyframes(Drives(), ties, KeyframeBundleOptions(), VoxelMapOptions(),
                      SlidingWindowOptions(), {}, InMemory);
  EXPECT_EQ(result.refusal, "too few planes are seen by two keyframes or more");
  EXPECT_EQ(result.poses[3].t, ties.poses[3].t);
  KeyframeBundleOptions none;
  none.rounds = 0;
  EXPECT_THROW(AdjustKeyframes(Drives(), ties, none, VoxelMapOptions(), SlidingWindowOptions(), {},
                               InMemory),
               OptionError);
}

TEST(TiledModel, HasTheMinimumOfTheDenseSolve) {
  const Driven& driven = Drives();
  const WorkSharing alone;
  const TiledClusters clusters(driven, driven.ties.poses, VoxelMapOptions(), 20.0, alone, InMemory);
  const TiledProblem tiles(clusters, driven.ties.poses, {VoxelMapOptions(), {}, 0}, alone,
                           InMemory);
  BundleProblem whole = driven.ties;
  for (std::size_t tile = 0; tile < clusters.size(); ++tile) {
    const TileProblem part = tiles.Read(tile);
    for (Plane plane : part.bundle.planes) {
      plane.first += static_cast<std::int32_t>(whole.observations.size());
      whole.planes.push_back(plane);
    }
    for (PlaneObservation o : part.bundle.observations) {
      o.frame = part.frames[static_cast<std::size_t>(o.frame)];
      whole.observations.push_back(o);
    }
  }
  EXPECT_EQ(whole.planes.size(), tiles.planes());
  EXPECT_EQ(whole.observations.size(), tiles.observations());
  const BundleAdjusterOptions solver = {50, 1e-14, 20};
  const BundleResult dense = AdjustBundle(whole, solver);
  TiledModel model(tiles, driven.ties, alone);
  const BundleResult tiled =
      MinimiseInTrustRegion(driven.ties.poses, solver, nullptr, false, &model);
  EXPECT_NEAR(tiled.initial_cost, dense.initial_cost, 1e-11 * dense.initial_cost);
  EXPECT_NEAR(tiled.final_cost, dense.final_cost, 1e-9 * dense.final_cost);
  for (std::size_t k = 0; k < dense.poses.size(); ++k)
    EXPECT_LT((tiled.poses[k].t - dense.poses[k].t).norm(), 1e-5);
}

TEST(SumBeyond, KeepsTheCostAtThesePoses) {
  const Driven& driven = Drives();
  const WorkSharing alone;
  const TiledClusters clusters(driven, driven.ties.poses, VoxelMapOptions(), 20.0, alone, InMemory);
  const TiledProblem tiles(clusters, driven.ties.poses, {VoxelMapOptions(), {}, 0}, alone,
                           InMemory);
  for (std::size_t tile = 0; tile < clusters.size(); ++tile) {
    TileProblem part = tiles.Read(tile);
    if (part.frames.empty()) continue;
    std::vector<SE3> poses;
    for (const std::int32_t frame : part.frames)
      poses.push_back(driven.ties.poses[static_cast<std::size_t>(frame)]);
    const double before = EigenvalueCost(part.bundle, poses);
    SumBeyond(3, poses, &part.bundle);
    EXPECT_NEAR(EigenvalueCost(part.bundle, poses), before, 1e-9 * before + 1e-12);
    for (const Plane& plane : part.bundle.planes) {
      EXPECT_LE(plane.count, 3);
      for (int o = plane.first + 1; o < plane.first + plane.count; ++o)
        EXPECT_LT(part.bundle.observations[static_cast<std::size_t>(o) - 1].frame,
                  part.bundle.observations[static_cast<std::size_t>(o)].frame);
    }
  }
}

}  // namespace
}  // namespace lamina
