// The apartment, the hall and the stairwell of tools/synth/stations.h.
#include <algorithm>
#include <cmath>

#include "tools/synth/engine/random.h"
#include "tools/synth/scenes/furniture.h"
#include "tools/synth/scenes/stairs.h"
#include "tools/synth/scenes/station_scenes.h"

namespace lamina::synth {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr float kDoorWidth = 0.95F, kDoorHeight = 2.05F, kWall = 0.12F, kCeiling = 2.6F;

// Along x from 0 to `length`, on y in [0, kWall], with doors that begin at these places.
void AddWall(const ShapeBuilder& at, float length, const std::vector<float>& doors) {
  float from = 0.0F;
  for (const float door : doors) {
    at.Box({from, 0.0F, 0.0F}, {door, kWall, kCeiling}, Material::kPlaster);
    at.Box({door, 0.0F, kDoorHeight}, {door + kDoorWidth, kWall, kCeiling}, Material::kPlaster);
    for (const float x : {door, door + kDoorWidth - 0.05F}) {
      at.Box({x, -0.03F, 0.0F}, {x + 0.05F, kWall + 0.03F, kDoorHeight}, Material::kWood);
    }
    from = door + kDoorWidth;
  }
  at.Box({from, 0.0F, 0.0F}, {length, kWall, kCeiling}, Material::kPlaster);
}

// Rooms: three below a corridor along x, two above it.
constexpr float kFlatX = 13.0F, kFlatY = 10.0F, kCorridorLow = 4.2F, kCorridorHigh = 5.8F;

void FillFlat(const ShapeBuilder& at, HashStream* random) {
  at.Box(Vector3f::Zero(), {kFlatX, kFlatY, kCeiling}, Material::kPlaster);  // seen from within
  AddWall(at.At({0.0F, kCorridorLow - kWall, 0.0F}), kFlatX, {2.4F, 6.3F, 10.6F});
  AddWall(at.At({0.0F, kCorridorHigh, 0.0F}), kFlatX, {3.2F, 9.0F});
  for (const float x : {4.3F, 8.7F}) {
    AddWall(at.At({x, 0.0F, 0.0F}, 0.5F * kHalfTurn), kCorridorLow, {});
  }
  AddWall(at.At({6.6F, kCorridorHigh, 0.0F}, 0.5F * kHalfTurn), kFlatY - kCorridorHigh, {2.2F});
  AddShelf(at.At({0.4F, kCorridorLow - 0.5F, 0.0F}), 1.6F, 2.1F, random);
  AddShelf(at.At({7.0F, kFlatY - 0.35F, 0.0F}), 2.4F, 1.8F, random);
  AddShelf(at.At({0.35F, 8.6F, 0.0F}, 0.5F * kHalfTurn), 2.0F, 2.2F, random);
  AddSofa(at.At({3.4F, kFlatY - 0.6F, 0.0F}));
  AddSofa(at.At({11.6F, 0.6F, 0.0F}, kHalfTurn));
  at.Box({4.6F, 0.0F, 0.0F}, {8.4F, 0.6F, 0.9F}, Material::kWood);  // kitchen
  at.Box({4.6F, 0.0F, 1.45F}, {7.2F, 0.35F, 2.1F}, Material::kWood);
  at.Box({7.8F, 0.0F, 0.9F}, {8.4F, 0.6F, 2.0F}, Material::kMetal);
  at.Box({0.2F, 0.2F, 0.0F}, {2.2F, 1.7F, 0.5F}, Material::kCloth);  // bed
  at.Box({0.1F, 0.2F, 0.5F}, {0.2F, 1.7F, 1.0F}, Material::kWood);
  at.Box({12.3F, 7.4F, 0.0F}, {12.95F, 9.4F, 2.0F}, Material::kWood);
  AddPlant(at.At({5.9F, 6.4F, 0.0F}), random);
  AddPlant(at.At({9.2F, 3.6F, 0.0F}), random);
  for (const float x : {1.2F, 5.4F, 9.6F}) {
    AddWallFrame(at.At({x, 0.0F, 0.0F}), 1.5F, 1.1F, 2.2F, 0.15F, Material::kGlass);
    AddWallFrame(at.At({x + 1.5F, kFlatY, 0.0F}, kHalfTurn), 1.5F, 0.9F, 2.2F, 0.15F,
                 Material::kGlass);
  }
}

// What people move while the scanner is carried on: seldom, and not far.
void FillMovable(const ShapeBuilder& at, std::size_t scan, std::int64_t seed) {
  const auto draw = [&](std::int64_t thing, std::int64_t what, double range) {
    // Each thing stays for some scans, at times of its own.
    const auto epoch = (static_cast<std::int64_t>(scan) + 5 * thing) / 9;
    return static_cast<float>(range *
                              (2.0 * UniformFrom(HashOf({seed, thing, what, epoch})) - 1.0));
  };
  static constexpr float kChairs[][2] = {{6.2F, 2.2F}, {7.0F, 2.9F},  {10.3F, 2.0F},
                                         {2.5F, 7.6F}, {10.5F, 7.4F}, {9.4F, 8.2F}};
  std::int64_t thing = 0;
  for (const auto& place : kChairs) {
    ++thing;
    AddChair(at.At({place[0] + draw(thing, 0, 0.4), place[1] + draw(thing, 1, 0.4), 0.0F},
                   draw(thing, 2, 2.0)));
  }
  AddTable(at.At({6.6F + draw(20, 0, 0.15), 2.6F, 0.0F}, draw(20, 1, 0.2)), 1.3F, 0.8F, 0.74F);
  AddTable(at.At({10.0F, 7.8F + draw(21, 0, 0.15), 0.0F}, draw(21, 1, 0.2)), 1.6F, 0.9F, 0.74F);
  // Door leaves, wide open give or take.
  for (const float x : {2.4F, 6.3F, 10.6F}) {
    ++thing;
    at.At({x, kCorridorLow - kWall, 0.0F}, -1.75F + draw(thing, 3, 0.25))
        .Box({0.0F, -0.02F, 0.02F}, {kDoorWidth - 0.08F, 0.02F, kDoorHeight - 0.03F},
             Material::kWood);
  }
}

constexpr float kHallX = 56.0F, kHallY = 17.0F, kHallZ = 9.0F;

// An arch of segments between two pillars along y, its feet at z = 0.
void AddArch(const ShapeBuilder& at, float span) {
  constexpr int kSegments = 8;
  const float radius = 0.5F * span;
  for (int i = 0; i < kSegments; ++i) {
    const float a = kHalfTurn * static_cast<float>(i) / kSegments;
    const float b = kHalfTurn * static_cast<float>(i + 1) / kSegments;
    const Vector3f from(-0.4F, radius - radius * std::cos(a), radius * std::sin(a));
    const Vector3f to(-0.4F, radius - radius * std::cos(b), radius * std::sin(b));
    at.Quad(from, to - from, {0.8F, 0.0F, 0.0F}, Material::kPlaster);
  }
}

void FillColumnHall(const ShapeBuilder& at, HashStream* random) {
  at.Box(Vector3f::Zero(), {kHallX, kHallY, kHallZ}, Material::kPlaster);
  constexpr float kAisle = 4.2F, kPitch = 4.4F;
  for (float x = 3.0F; x < kHallX; x += kPitch) {
    for (const float y : {kAisle, kHallY - kAisle}) {
      at.Box({x - 0.55F, y - 0.55F, 0.0F}, {x + 0.55F, y + 0.55F, 0.5F}, Material::kConcrete);
      at.Tube({x, y, 0.5F}, {x, y, 4.0F}, 0.38F, Material::kConcrete);
      at.Box({x - 0.5F, y - 0.5F, 4.0F}, {x + 0.5F, y + 0.5F, 4.4F}, Material::kConcrete);
    }
    AddArch(at.At({x, 0.0F, 4.4F}), kAisle);
    AddArch(at.At({x, kHallY - kAisle, 4.4F}), kAisle);
    at.Box({x - 0.3F, kAisle, kHallZ - 0.8F}, {x + 0.3F, kHallY - kAisle, kHallZ},
           Material::kPlaster);
    AddWallFrame(at.At({x + 1.2F, 0.0F, 0.0F}), 1.9F, 0.05F, 2.9F, 0.2F, Material::kWood);
  }
  // Galleries.
  for (const float y : {kAisle - 0.4F, kHallY - kAisle + 0.2F}) {
    at.Box({0.0F, y, 4.4F}, {kHallX, y + 0.2F, 5.6F}, Material::kConcrete);
  }
  for (int i = 0; i < 26; ++i) {  // benches, notice boards, a kiosk
    const float x = Draw(random, 2.0, kHallX - 2.0);
    const float y = random->Chance(0.5) ? 1.0F : kHallY - 1.0F;
    const ShapeBuilder here = at.At({x, y, 0.0F}, Draw(random, -0.2, 0.2));
    if (random->Chance(0.5)) {
      AddTable(here, Draw(random, 1.2, 2.2), 0.5F, Draw(random, 0.4, 0.8));
    } else {
      here.Box({-0.7F, -0.04F, 0.5F}, {0.7F, 0.04F, Draw(random, 1.7, 2.2)}, Material::kWood);
    }
  }
  at.Box({30.0F, 6.4F, 0.0F}, {33.0F, 8.2F, 2.6F}, Material::kWood);
}

}  // namespace

StationWorld MakeApartment(std::size_t scans, std::int64_t seed) {
  StationWorld world;
  HashStream random(HashOf({seed, 0xa9a7}));
  FillFlat(ShapeBuilder(&world.fixed, Vector3f::Zero(), 0.0F), &random);
  const std::vector<Vector3d> way = {{2.6, 2.4, 0}, {2.9, 4.9, 0},  {3.6, 5.1, 0},  {3.7, 7.0, 0},
                                     {4.6, 8.0, 0}, {3.7, 6.9, 0},  {3.8, 5.1, 0},  {6.7, 4.9, 0},
                                     {6.8, 3.4, 0}, {6.8, 1.5, 0},  {6.8, 4.0, 0},  {8.6, 5.0, 0},
                                     {9.4, 5.2, 0}, {9.5, 6.8, 0},  {8.4, 7.8, 0},  {9.5, 6.6, 0},
                                     {9.7, 5.1, 0}, {11.0, 4.9, 0}, {11.1, 3.4, 0}, {10.8, 1.7, 0}};
  world.T_scene_lidar = StationsAlong(way, scans, 0.55, kTripod, 0.01, seed);
  for (std::size_t i = 0; i < scans; ++i) {
    FillMovable(ShapeBuilder(&world.moved.emplace_back(), Vector3f::Zero(), 0.0F), i, seed);
  }
  return world;
}

StationWorld MakeHauptgebaeude(std::size_t scans, std::int64_t seed) {
  StationWorld world;
  HashStream random(HashOf({seed, 0x4b9}));
  FillColumnHall(ShapeBuilder(&world.fixed, Vector3f::Zero(), 0.0F), &random);
  const std::vector<Vector3d> way = {{6, 2, 0},   {20, 2.3, 0}, {24, 6, 0},   {27, 9, 0},
                                     {38, 10, 0}, {44, 13, 0},  {50, 14.5, 0}};
  world.T_scene_lidar = StationsAlong(way, scans, 1.2, kTripod, 0.01, seed);
  return world;
}

StationWorld MakeStairStations(std::size_t scans, std::int64_t seed) {
  StationWorld world;
  FillStairwell(ShapeBuilder(&world.fixed, Vector3f::Zero(), 0.0F), seed);
  const StairPath path(Vector3d(0.0, 0.0, kTripod), 1.0);
  HashStream random(HashOf({seed, 0x57a1}));
  for (std::size_t i = 0; i < scans; ++i) {
    const UprightPose here = path.At(0.5 * static_cast<double>(i));
    const Vector3d turn(random.Uniform(-0.01, 0.01), random.Uniform(-0.01, 0.01),
                        here.yaw + random.Uniform(-0.2, 0.2));
    world.T_scene_lidar.emplace_back(ExpSO3({0, 0, turn.z()}) * ExpSO3({turn.x(), turn.y(), 0}),
                                     here.position);
  }
  return world;
}

std::vector<SE3> StationsAlong(const std::vector<Eigen::Vector3d>& corners, std::size_t scans,
                               double spacing_m, double height_m, double lean_rad,
                               std::int64_t seed) {
  HashStream random(HashOf({seed, 0x57a7}));
  std::vector<double> reached = {0.0};
  for (std::size_t i = 1; i < corners.size(); ++i) {
    reached.push_back(reached.back() + (corners[i] - corners[i - 1]).norm());
  }
  const auto at = [&](double s) -> Vector3d {
    std::size_t i = 1;
    while (i + 1 < corners.size() && reached[i] < s) ++i;
    const double share = (s - reached[i - 1]) / (reached[i] - reached[i - 1]);
    return corners[i - 1] + std::clamp(share, 0.0, 1.0) * (corners[i] - corners[i - 1]);
  };
  std::vector<SE3> stations;
  for (std::size_t i = 0; i < scans; ++i) {
    const double s = std::min(reached.back(), spacing_m * static_cast<double>(i));
    // The mean over a metre: corners are cut, and directions turn step by step.
    Vector3d here = Vector3d::Zero(), ahead = Vector3d::Zero();
    for (const double ds : {-0.5, -0.25, 0.0, 0.25, 0.5}) {
      here += 0.2 * at(std::max(0.0, s + ds));
      ahead += 0.2 * at(s + ds + 1.0);
    }
    // At the end of the way the scanner is turned where it stands.
    const Vector3d way = (ahead - here).norm() > 0.3 ? Vector3d(ahead - here)
                                                     : corners.back() - corners[corners.size() - 2];
    const double yaw = std::atan2(way.y(), way.x()) + random.Uniform(-0.26, 0.26);
    const Vector3d lean(random.Uniform(-lean_rad, lean_rad), random.Uniform(-lean_rad, lean_rad),
                        0.0);
    const Vector3d place = here + Vector3d(random.Uniform(-0.05, 0.05), random.Uniform(-0.05, 0.05),
                                           height_m + random.Uniform(-0.03, 0.03));
    stations.emplace_back(ExpSO3({0.0, 0.0, yaw}) * ExpSO3(lean), place);
  }
  return stations;
}

}  // namespace lamina::synth
