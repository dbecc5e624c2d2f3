#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "tools/synth/engine/bvh.h"
#include "tools/synth/engine/random.h"
#include "tools/synth/engine/scene.h"
#include "tools/synth/scenes/ground.h"
#include "tools/synth/scenes/indoor.h"
#include "tools/synth/scenes/street.h"

namespace lamina::synth {
namespace {

using Eigen::Vector3f;

Vector3f RandomVector(HashStream* random, double size) {
  Vector3f v;
  for (int i = 0; i < 3; ++i) v[i] = static_cast<float>(random->Uniform(-size, size));
  return v;
}

Primitive RandomPrimitive(HashStream* random) {
  const Vector3f centre = RandomVector(random, 20.0);
  const Vector3f edge = RandomVector(random, 2.0);
  const Vector3f size = RandomVector(random, 1.5).cwiseAbs() + Vector3f::Constant(0.05F);
  const auto yaw = static_cast<float>(random->Uniform(-3.0, 3.0));
  switch (random->Index(5)) {
    case 0:
      return MakeQuad(centre, edge, RandomVector(random, 2.0), Material::kBrick);
    case 1:
      return MakeTriangle(centre, edge, RandomVector(random, 2.0), Material::kBrick);
    case 2:
      return MakeBox(centre, size, yaw, Material::kBrick);
    case 3:
      return MakeTube(centre, centre + edge, size.x(), Material::kBrick);
    default:
      return MakeEllipsoid(centre, size, Material::kBrick);
  }
}

// From somewhere outside towards somewhere near the primitives.
Ray RandomRay(HashStream* random, const Vector3f& target) {
  const Vector3f origin = RandomVector(random, 60.0);
  return {origin, (target + RandomVector(random, 1.0) - origin).normalized()};
}

TEST(SynthPrimitive, RaysEndOnTheSurface) {
  HashStream random(1);
  int hits = 0;
  for (int i = 0; i < 20000; ++i) {
    const Primitive p = RandomPrimitive(&random);
    const Ray ray = RandomRay(&random, p.centre);
    const float range = Intersect(p, ray);
    if (range == kNoHit) continue;
    ++hits;
    const Vector3f point = ray.At(range);
    // Rays that graze a curved surface lose digits.
    const float cosine = std::abs(NormalAt(p, point).dot(ray.direction));
    EXPECT_LT(SurfaceDistance(p, point) * cosine, 1e-4F) << "shape " << static_cast<int>(p.shape);
    const Bounds bounds = BoundsOf(p);
    EXPECT_GT((point.array() - bounds.low).minCoeff(), -1e-3F);
    EXPECT_GT((bounds.high - point.array()).minCoeff(), -1e-3F);
  }
  EXPECT_GT(hits, 5000);
}

// A ray cannot meet a surface before it has come as far as the surface is away.
TEST(SynthPrimitive, DistanceIsABoundForEveryRay) {
  HashStream random(2);
  for (int i = 0; i < 20000; ++i) {
    const Primitive p = RandomPrimitive(&random);
    const Ray ray = RandomRay(&random, p.centre);
    if (p.shape == Shape::kEllipsoid && (ray.origin - p.centre).norm() < 2.7F) continue;
    EXPECT_GT(Intersect(p, ray), SurfaceDistance(p, ray.origin) - 1e-3F);
  }
}

TEST(SynthPrimitive, DistanceToAnEllipsoidIsThatOfItsNearestPoint) {
  const Vector3f radii(0.4F, 0.4F, 1.1F);
  const Primitive p = MakeEllipsoid(Vector3f::Zero(), radii, Material::kFoliage);
  HashStream random(5);
  for (int i = 0; i < 2000; ++i) {
    const Vector3f on_sphere = RandomVector(&random, 1.0).normalized();
    const Vector3f foot = on_sphere.cwiseProduct(radii);
    const auto away = static_cast<float>(random.Uniform(0.0, 5.0));
    EXPECT_NEAR(SurfaceDistance(p, foot + away * NormalAt(p, foot)), away, 2e-5F);
  }
}

TEST(SynthPrimitive, BoxIsHitFromWithin) {
  const Primitive box = MakeBox(Vector3f::Zero(), {4.0F, 3.0F, 1.5F}, 0.0F, Material::kPlaster);
  EXPECT_FLOAT_EQ(Intersect(box, {Vector3f(1.0F, 0.0F, 0.0F), Vector3f::UnitX()}), 3.0F);
  EXPECT_FLOAT_EQ(Intersect(box, {Vector3f(1.0F, 0.0F, 0.0F), -Vector3f::UnitZ()}), 1.5F);
  EXPECT_FLOAT_EQ(SurfaceDistance(box, Vector3f(0.0F, 0.0F, 1.0F)), 0.5F);
}

TEST(PrimitiveTree, FindsWhatTestingAllPrimitivesFinds) {
  HashStream random(3);
  std::vector<Primitive> primitives;
  for (int i = 0; i < 700; ++i) primitives.push_back(RandomPrimitive(&random));
  const PrimitiveTree tree(primitives);
  ASSERT_EQ(tree.size(), primitives.size());
  int hits = 0;
  for (int i = 0; i < 3000; ++i) {
    const Ray ray = RandomRay(&random, RandomVector(&random, 20.0));
    float expected = 80.0F;
    for (const Primitive& p : primitives) expected = std::min(expected, Intersect(p, ray));
    float range = 80.0F;
    const Primitive* hit = tree.ClosestHit(ray, &range);
    EXPECT_EQ(range, expected);
    EXPECT_EQ(hit != nullptr, expected < 80.0F);
    hits += hit != nullptr;

    const Vector3f point = RandomVector(&random, 25.0);
    float nearest = 3.0F;
    for (const Primitive& p : primitives) nearest = std::min(nearest, SurfaceDistance(p, point));
    EXPECT_EQ(tree.Distance(point, 3.0F), nearest);
  }
  EXPECT_GT(hits, 500);
}

TEST(PrimitiveTree, EmptyTreeHasNoSurface) {
  const PrimitiveTree tree{std::vector<Primitive>{}};
  float range = 10.0F;
  EXPECT_EQ(tree.ClosestHit({Vector3f::Zero(), Vector3f::UnitX()}, &range), nullptr);
  EXPECT_EQ(tree.Distance(Vector3f::Zero(), 5.0F), 5.0F);
}

class GroundTest : public ::testing::Test {
 protected:
  Ground ground_{Terrain(7), Eigen::Vector2d(960.0, -640.0), Eigen::Vector2i(96, 64), 5.5F, 0.12F};
};

TEST_F(GroundTest, MarchFindsTheFirstCrossing) {
  HashStream random(4);
  for (int i = 0; i < 2000; ++i) {
    const auto x = static_cast<float>(random.Uniform(5.0, 90.0));
    const auto y = static_cast<float>(random.Uniform(5.0, 59.0));
    Ray ray;
    ray.origin = {x, y, ground_.HeightAt(x, y) + 1.73F};
    const double azimuth = random.Uniform(-3.14, 3.14);
    const double down = random.Uniform(-0.45, 0.02);
    ray.direction = Vector3f(static_cast<float>(std::cos(azimuth)),
                             static_cast<float>(std::sin(azimuth)), static_cast<float>(down))
                        .normalized();
    // Walk in small steps until below ground or out of the block.
    constexpr float kStep = 0.01F;
    float walked = 0.0F;
    bool crossed = false;
    for (;; walked += kStep) {
      const Vector3f p = ray.At(walked);
      if (p.x() < 0.5F || p.x() > 95.5F || p.y() < 0.5F || p.y() > 63.5F) break;
      crossed = p.z() < ground_.HeightAt(p.x(), p.y());
      if (crossed) break;
    }
    const GroundHit hit = ground_.Cast(ray, 0.0F, walked + 2.0F * kStep);
    if (crossed) {
      // Walking may miss a crest that the ray just touches.
      EXPECT_LT(hit.range, walked + kStep) << "ray " << i;
      EXPECT_LT(ground_.Distance(ray.At(hit.range)), 1e-3F) << "ray " << i;
    } else if (hit.range != kNoHit) {
      EXPECT_LT(ground_.Distance(ray.At(hit.range)), 2e-3F) << "ray " << i;
    }
  }
}

TEST_F(GroundTest, CurbIsAStepUpIntoTheParcel) {
  EXPECT_NEAR(ground_.HeightAt(5.6F, 30.0F) - ground_.HeightAt(5.4F, 30.0F), 0.12F, 0.02F);
  // A ray level with the middle of the curb's face.
  const float z = ground_.HeightAt(5.4F, 30.0F) + 0.06F;
  const GroundHit hit = ground_.Cast({Vector3f(4.9F, 30.0F, z), Vector3f::UnitX()}, 0.0F, 20.0F);
  EXPECT_NEAR(hit.range, 0.6F, 1e-3F);
  EXPECT_NEAR(std::abs(hit.normal.x()), 1.0F, 1e-6F);
}

TEST(Terrain, SmoothHeightHasNoJumps) {
  const Terrain terrain(3);
  for (double x = -40.0; x < 600.0; x += 0.37) {
    EXPECT_NEAR(terrain.SmoothHeight(x, 5.0), terrain.SmoothHeight(x + 1e-3, 5.0), 1e-4);
    EXPECT_NEAR(terrain.SmoothHeight(x, 5.0), terrain.Height(x, 5.0), 0.0211);
  }
}

// A ray visits the blocks below it alone, so nothing may reach out of its own.
TEST(StreetModel, NothingReachesOutOfItsBlock) {
  const StreetModel model(11);
  const Eigen::Vector2d size = model.BlockSize();
  for (std::int64_t x = -3; x < 3; ++x) {
    for (std::int64_t y = -2; y < 2; ++y) {
      const auto block = model.MakeBlock({x, y});
      EXPECT_GT(block->tree.size(), 1500u);
      const Bounds& bounds = block->tree.bounds();
      EXPECT_GE(bounds.low.head<2>().minCoeff(), 0.0F) << x << " " << y;
      EXPECT_LE(bounds.high.x(), size.x()) << x << " " << y;
      EXPECT_LE(bounds.high.y(), size.y()) << x << " " << y;
    }
  }
}

TEST(SyntheticScene, CastsAcrossBlocksAndFromAnyOfThem) {
  const SyntheticScene scene(MakeCorridor(), 16);
  const Eigen::Vector3d eye(1000.3, 3.2, 1.4);
  const SceneView view = scene.ViewAround(eye, 150.0);
  const Eigen::Vector3d direction = Eigen::Vector3d(-1.0, 0.0, -0.01).normalized();
  const auto hit = view.Cast(eye, direction, 200.0);
  ASSERT_TRUE(hit.has_value());
  EXPECT_NEAR(hit->range_m, 1.4 / -direction.z(), 1e-3);
  EXPECT_FALSE(view.Cast(eye, direction, 100.0).has_value());
  EXPECT_FALSE(view.Cast(eye, Eigen::Vector3d::UnitX(), 149.0).has_value());
  EXPECT_NEAR(view.SurfaceDistance(eye, 10.0), 1.2, 1e-5);
  EXPECT_EQ(view.SurfaceDistance(eye, 0.5), 0.5);
}

TEST(SyntheticScene, ForgottenBlocksComeBackTheSame) {
  const SyntheticScene scene(std::make_unique<StreetModel>(5), 30);
  const auto look = [&scene](double x) {
    const Eigen::Vector3d eye(x, -1.7, 6.0);
    const SceneView view = scene.ViewAround(eye, 100.0);
    std::vector<double> ranges;
    for (int i = 0; i < 500; ++i) {
      const double azimuth = 0.05 * i;
      const Eigen::Vector3d direction(std::cos(azimuth), std::sin(azimuth), -0.001 * i);
      const auto hit = view.Cast(eye, direction.normalized(), 100.0);
      ranges.push_back(hit ? hit->range_m : -1.0);
    }
    return ranges;
  };
  const std::vector<double> before = look(50.0);
  for (double x = 50.0; x < 5000.0; x += 90.0) {
    look(x);
    EXPECT_LE(scene.cached_blocks(), 30u);
  }
  EXPECT_EQ(look(50.0), before);
}

}  // namespace
}  // namespace lamina::synth
