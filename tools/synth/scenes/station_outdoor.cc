// The plain, the gazebo and the wood of tools/synth/stations.h.
#include <cmath>
#include <functional>

#include "tools/synth/engine/random.h"
#include "tools/synth/scenes/objects.h"
#include "tools/synth/scenes/station_scenes.h"

namespace lamina::synth {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

// Waves of ground, the longest `amplitude_m` high, shorter ones in proportion.
class Slopes {
 public:
  Slopes(double amplitude_m, std::int64_t seed) {
    HashStream random(HashOf({seed, 0x510e}));
    for (double length = 28.0; length > 0.9; length *= 0.62) {
      const double heading = random.Uniform(0.0, 6.28);
      const double rate = 6.2832 / length;
      waves_.push_back({amplitude_m * length / 28.0, rate * std::cos(heading),
                        rate * std::sin(heading), random.Uniform(0.0, 6.28)});
    }
  }
  float At(float x, float y) const {
    double z = 0.0;
    for (const Wave& w : waves_) z += w.height * std::sin(w.x * x + w.y * y + w.phase);
    return static_cast<float>(z);
  }

 private:
  struct Wave {
    double height, x, y, phase;
  };
  std::vector<Wave> waves_;
};

// Two triangles for each cell of `cell` metres, x and y in [-half, half].
void AddSlopes(const Slopes& slopes, float half, float cell, const ShapeBuilder& at) {
  const int cells = static_cast<int>(2.0F * half / cell);
  const auto point = [&](int i, int j) {
    const float x = cell * static_cast<float>(i) - half;
    const float y = cell * static_cast<float>(j) - half;
    return Vector3f(x, y, slopes.At(x, y));
  };
  for (int i = 0; i < cells; ++i) {
    for (int j = 0; j < cells; ++j) {
      const Vector3f a = point(i, j), b = point(i + 1, j), c = point(i, j + 1);
      const Vector3f d = point(i + 1, j + 1);
      at.Triangle(a, b - a, c - a, Material::kGrass);
      at.Triangle(d, c - d, b - d, Material::kGrass);
    }
  }
}

struct Site {
  const ShapeBuilder& at;
  const Slopes& slopes;
  HashStream* random;

  ShapeBuilder On(float x, float y, float yaw = 0.0F) const {
    return at.At({x, y, slopes.At(x, y)}, yaw);
  }
  // Somewhere within `half` of the origin in x and y, `clear` metres from the way.
  ShapeBuilder Anywhere(float half, const std::vector<Vector3d>& way, double clear) const {
    for (;;) {
      const float x = Draw(random, -half, half), y = Draw(random, -half, half);
      bool free = true;
      for (std::size_t i = 1; i < way.size() && free; ++i) {
        for (double s = 0.0; s <= 1.0; s += 0.05) {
          const Vector3d p = way[i - 1] + s * (way[i] - way[i - 1]);
          if (std::hypot(p.x() - x, p.y() - y) < clear) free = false;
        }
      }
      if (free) return On(x, y, Draw(random, 0.0, 6.28));
    }
  }
};

std::vector<Vector3d> OnGround(std::vector<Vector3d> way, const Slopes& slopes) {
  // Densely, so that stations between the corners stand on the ground, too.
  std::vector<Vector3d> dense;
  for (std::size_t i = 1; i < way.size(); ++i) {
    for (double s = 0.0; s < 0.999; s += 0.1) {
      dense.push_back(way[i - 1] + s * (way[i] - way[i - 1]));
    }
  }
  dense.push_back(way.back());
  for (Vector3d& p : dense) p.z() = slopes.At(static_cast<float>(p.x()), static_cast<float>(p.y()));
  return dense;
}

// Leaves of about `size`, in a ball about a place.
void AddLeaves(const ShapeBuilder& at, const Vector3f& centre, float reach, int count, float size,
               HashStream* random) {
  for (int i = 0; i < count; ++i) {
    const Vector3f off(Draw(random, -1, 1), Draw(random, -1, 1), Draw(random, -1, 1));
    at.Spheroid(centre + reach * off, Draw(random, 0.6, 1.3) * size, 0.6F * size,
                Material::kFoliage);
  }
}

// A pillar, and what climbs up on it.
void AddOvergrownPillar(const ShapeBuilder& at, float height, bool summer, HashStream* random) {
  at.Box({-0.14F, -0.14F, -0.3F}, {0.14F, 0.14F, height}, Material::kConcrete);
  for (int i = 0; i < 4; ++i) {
    Vector3f from(Draw(random, -0.2, 0.2), Draw(random, -0.2, 0.2), 0.0F);
    while (from.z() < height) {
      const Vector3f to(Draw(random, -0.22, 0.22), Draw(random, -0.22, 0.22),
                        from.z() + Draw(random, 0.3, 0.7));
      at.Tube(from, to, 0.015F, Material::kWood);
      from = to;
    }
  }
  if (!summer) return;
  for (float z = 0.3F; z < height; z += 0.25F) {
    AddLeaves(at, {0.0F, 0.0F, z}, 0.28F, 6, 0.05F, random);
  }
}

void AddPergola(const ShapeBuilder& at, bool summer, HashStream* random) {
  constexpr float kX = 8.0F, kY = 5.0F, kHeight = 2.9F;
  for (float x = 0.0F; x <= kX; x += 2.0F) {
    for (const float y : {0.0F, kY})
      AddOvergrownPillar(at.At({x, y, 0.0F}), kHeight, summer, random);
    at.Box({x - 0.06F, -0.5F, kHeight}, {x + 0.06F, kY + 0.5F, kHeight + 0.16F}, Material::kWood);
  }
  for (const float y : {0.0F, kY}) {
    at.Box({-0.4F, y - 0.07F, kHeight + 0.16F}, {kX + 0.4F, y + 0.07F, kHeight + 0.34F},
           Material::kWood);
  }
  for (float y = 0.4F; y < kY; y += 0.6F) {
    at.Tube({-0.2F, y, kHeight + 0.2F}, {kX + 0.2F, y, kHeight + 0.2F}, 0.03F, Material::kWood);
    if (!summer) continue;
    for (float x = 0.0F; x < kX; x += 0.4F) {
      AddLeaves(at, {x, y, kHeight + 0.3F}, 0.3F, 3, 0.07F, random);
    }
  }
}

// A trunk with some branches; `leaves` leaf clusters in its crown, and those that hang low.
void AddBranchedTree(const ShapeBuilder& at, int leaves, HashStream* random) {
  const float radius = Draw(random, 0.1, 0.28);
  const float height = Draw(random, 7.0, 12.0);
  const Vector3f top(Draw(random, -0.5, 0.5), Draw(random, -0.5, 0.5), height);
  at.Tube({0.0F, 0.0F, -0.3F}, top, radius, Material::kWood);
  for (int i = 0; i < 6; ++i) {
    const Vector3f from = Draw(random, 0.25, 0.9) * top;
    const float angle = Draw(random, 0.0, 2.0 * kHalfTurn);
    const float reach = Draw(random, 0.8, 2.2);
    const Vector3f to =
        from + Vector3f(reach * std::cos(angle), reach * std::sin(angle), Draw(random, 0.1, 1.0));
    at.Tube(from, to, 0.2F * radius, Material::kWood);
    AddLeaves(at, to, 0.7F, leaves / 6, 0.1F, random);
  }
}

}  // namespace

StationWorld MakePlain(std::size_t scans, std::int64_t seed) {
  StationWorld world;
  const Slopes slopes(0.75, seed);
  const ShapeBuilder at(&world.fixed, Vector3f::Zero(), 0.0F);
  HashStream random(HashOf({seed, 0x91a1}));
  const Site site{at, slopes, &random};
  const std::vector<Vector3d> way = {{-11, -7, 0}, {-3, -3, 0}, {4, -4, 0}, {10, 2, 0}, {11, 8, 0}};
  AddSlopes(slopes, 45.0F, 0.75F, at);
  for (int i = 0; i < 320; ++i) {
    const float radius = Draw(&random, 0.08, 0.35) * (random.Chance(0.1) ? 3.0F : 1.0F);
    site.Anywhere(40.0F, way, 0.6 + radius)
        .Spheroid(Vector3f::Zero(), radius, Draw(&random, 0.5, 0.9) * radius, Material::kConcrete);
  }
  for (int i = 0; i < 150; ++i) {
    AddLeaves(site.Anywhere(40.0F, way, 0.8), {0.0F, 0.0F, 0.1F}, 0.2F, 8, 0.06F, &random);
  }
  world.T_scene_lidar = StationsAlong(OnGround(way, slopes), scans, 0.9, kTripod, 0.05, seed);
  return world;
}

StationWorld MakeGazebo(bool summer, std::size_t scans, std::int64_t seed) {
  StationWorld world;
  const Slopes slopes(0.18, seed);
  const ShapeBuilder at(&world.fixed, Vector3f::Zero(), 0.0F);
  HashStream random(HashOf({seed, 0x6a2e}));
  const Site site{at, slopes, &random};
  const std::vector<Vector3d> way = {{-10, -6, 0}, {-5, -3, 0}, {-2, 0, 0}, {2, 0.3, 0},
                                     {5, 0, 0},    {8, 3, 0},   {6, 6, 0},  {1, 6, 0}};
  AddSlopes(slopes, 42.0F, 0.8F, at);
  AddPergola(at.At({-4.0F, -2.5F, slopes.At(0.0F, 0.0F)}), summer, &random);
  AddGardenWall(site.On(-16.0F, -10.0F), 30.0F, &random);
  AddGardenWall(site.On(15.0F, -9.0F, 0.5F * kHalfTurn), 22.0F, &random);
  AddHedge(site.On(-14.0F, 12.0F), 20.0F, &random);
  AddHouse(site.On(-20.0F, 20.0F), {14.0F, 8.0F, 2}, &random);
  for (int i = 0; i < 9; ++i) {
    AddBranchedTree(site.Anywhere(22.0F, way, 5.0), summer ? 240 : 0, &random);
  }
  for (int i = 0; i < 14; ++i) {
    const ShapeBuilder bush = site.Anywhere(16.0F, way, 2.0);
    AddLeaves(bush, {0.0F, 0.0F, 0.5F}, 0.5F, summer ? 60 : 12, 0.07F, &random);
  }
  for (int i = 0; i < 4; ++i) AddLamp(site.Anywhere(16.0F, way, 3.0), &random);
  world.T_scene_lidar = StationsAlong(OnGround(way, slopes), scans, 0.8, kTripod, 0.03, seed);
  return world;
}

StationWorld MakeWood(bool summer, std::size_t scans, std::int64_t seed) {
  StationWorld world;
  const Slopes slopes(0.35, seed);
  const ShapeBuilder at(&world.fixed, Vector3f::Zero(), 0.0F);
  HashStream random(HashOf({seed, 0x300d}));
  const Site site{at, slopes, &random};
  const std::vector<Vector3d> way = {{-14, -4, 0}, {-7, -1, 0}, {0, -2, 0}, {7, 2, 0}, {14, 3, 0}};
  AddSlopes(slopes, 45.0F, 0.8F, at);
  for (int i = 0; i < 110; ++i) {
    AddBranchedTree(site.Anywhere(38.0F, way, 1.6), summer ? 150 : 12, &random);
  }
  for (int i = 0; i < (summer ? 220 : 90); ++i) {  // undergrowth
    AddLeaves(site.Anywhere(32.0F, way, 1.2), {0.0F, 0.0F, 0.35F}, 0.4F, summer ? 30 : 10, 0.07F,
              &random);
  }
  for (int i = 0; i < 25; ++i) {  // fallen trunks
    const float length = Draw(&random, 2.0, 6.0);
    site.Anywhere(30.0F, way, 4.0)
        .Tube({-0.5F * length, 0.0F, 0.1F}, {0.5F * length, 0.0F, 0.3F}, Draw(&random, 0.08, 0.2),
              Material::kWood);
  }
  world.T_scene_lidar = StationsAlong(OnGround(way, slopes), scans, 0.75, kTripod, 0.03, seed);
  return world;
}

}  // namespace lamina::synth
