#include "tools/synth/stations.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <utility>

#include "core/base/angle.h"
#include "core/base/parallel.h"
#include "tools/synth/engine/random.h"
#include "tools/synth/engine/sensor.h"
#include "tools/synth/scenes/station_scenes.h"

namespace lamina {
namespace {

constexpr int kRays = 1081;
constexpr double kStep = Radians(0.25);
constexpr double kMaxTilt = Radians(60.0);
constexpr double kMinRange = 0.1, kMaxRange = 30.0, kFarRange = 10.0;
constexpr StampNs kPeriodNs =
    10'000'000'000;  // a scan takes some seconds, the way to the next more
constexpr std::array<int, 8> kScans = {45, 36, 31, 31, 32, 32, 37, 32};

synth::StationWorld MakeWorld(const StationOptions& o) {
  const auto own = kScans[static_cast<std::size_t>(o.scene)];
  const auto scans = static_cast<std::size_t>(o.scans == 0 ? own : o.scans);
  switch (o.scene) {
    case StationScene::kApartment:
      return synth::MakeApartment(scans, o.seed);
    case StationScene::kHauptgebaeude:
      return synth::MakeHauptgebaeude(scans, o.seed);
    case StationScene::kStairs:
      return synth::MakeStairStations(scans, o.seed);
    case StationScene::kPlain:
      return synth::MakePlain(scans, o.seed);
    case StationScene::kGazeboSummer:
    case StationScene::kGazeboWinter:
      return synth::MakeGazebo(o.scene == StationScene::kGazeboSummer, scans, o.seed);
    default:
      return synth::MakeWood(o.scene == StationScene::kWoodSummer, scans, o.seed);
  }
}

// A ray of the plane, turned up by the tilt.
Eigen::Vector3d Direction(double tilt, int ray) {
  const double a = (ray - kRays / 2) * kStep;
  return {std::cos(a) * std::cos(tilt), std::sin(a), std::cos(a) * std::sin(tilt)};
}

struct Returns {
  std::vector<ScanPoint> points;
  std::vector<Eigen::Vector3f> surface;
};

}  // namespace

const std::vector<std::string>& StationSceneNames() {
  static const std::vector<std::string> names = {"apartment",   "hauptgebaeude", "stairs_ethz",
                                                 "plain",       "gazebo_summer", "gazebo_winter",
                                                 "wood_summer", "wood_autumn"};
  return names;
}

void StationOptions::Visit(OptionVisitor& v) {
  v.EnumChoice("scene", &scene, StationSceneNames());
  v.Integer("scans", &scans, 0, 60);
  v.Integer("seed", &seed, 0, 2147483647);
  v.Number("noise_m", &noise_m, 0.0, 1.0);
  v.Integer("lines", &lines, 2, 10000);
  v.Integer("ray_step", &ray_step, 1, 1000);
}

StationSequence::StationSequence(const StationOptions& options) : options_(options) {
  CheckOptions(options, "stations");
  synth::StationWorld world = MakeWorld(options);
  fixed_ = synth::PrimitiveTree(std::move(world.fixed));
  T_scene_lidar_ = std::move(world.T_scene_lidar);
  for (auto& moved : world.moved) moved_.emplace_back(std::move(moved));
  moved_.resize(T_scene_lidar_.size());
}

std::string StationSequence::Name(std::size_t i) const {
  return fmt::format("synthetic scan {}", i);
}

StampNs StationSequence::Stamp(std::size_t i) const { return static_cast<StampNs>(i) * kPeriodNs; }

Trajectory StationSequence::Truth() const {
  Trajectory truth;
  const SE3 T_world_scene = T_scene_lidar_[0].Inverse();
  for (std::size_t i = 0; i < size(); ++i) {
    truth.push_back({Stamp(i), i == 0 ? SE3() : T_world_scene * T_scene_lidar_[i]});
  }
  return truth;
}

double StationSequence::SurfaceDistance(const Eigen::Vector3d& p_world, double bound_m) const {
  return fixed_.Distance((T_scene_lidar_[0] * p_world).cast<float>(), static_cast<float>(bound_m));
}

Scan StationSequence::Generate(std::size_t i, std::vector<Eigen::Vector3f>* surface) const {
  const SE3& T = T_scene_lidar_.at(i);
  const Eigen::Matrix3d R = T.R();
  const SE3 T_world_lidar = T_scene_lidar_[0].Inverse() * T;
  const auto lines = static_cast<std::size_t>(options_.lines);
  std::vector<Returns> of_lines(lines);
  ParallelChunks(lines, 1, [&](std::size_t line, std::size_t) {
    const double tilt =
        kMaxTilt * (2.0 * static_cast<double>(line) / static_cast<double>(lines - 1) - 1.0);
    for (int ray = 0; ray < kRays; ray += options_.ray_step) {
      const Eigen::Vector3d direction = Direction(tilt, ray);
      const synth::Ray cast{T.t.cast<float>(), (R * direction).cast<float>()};
      auto range = static_cast<float>(kMaxRange);
      const synth::Primitive* hit = fixed_.ClosestHit(cast, &range);
      if (const synth::Primitive* nearer = moved_[i].ClosestHit(cast, &range)) hit = nearer;
      if (hit == nullptr || range < kMinRange) continue;
      const std::uint64_t key = synth::HashOf(
          {options_.seed, static_cast<std::int64_t>(i), static_cast<std::int64_t>(line), ray});
      const double cosine = std::abs(synth::NormalAt(*hit, cast.At(range)).dot(cast.direction));
      if (!synth::IsReturned(hit->material, range, cosine, kMaxRange,
                             synth::UniformFrom(synth::ScrambleBits(key)))) {
        continue;
      }
      const double sigma = options_.noise_m * (range < kFarRange ? 1.0 : 2.0);
      const Eigen::Vector3f p =
          ((range + sigma * synth::GaussianFrom(key)) * direction).cast<float>();
      of_lines[line].points.push_back(
          {p.x(), p.y(), p.z(), synth::IntensityOf(hit->material, cosine)});
      if (surface != nullptr) {
        of_lines[line].surface.push_back(
            (T_world_lidar * (static_cast<double>(range) * direction)).cast<float>());
      }
    }
  });
  Scan scan;
  scan.stamp_ns = Stamp(i);
  for (const Returns& r : of_lines) {
    scan.points.insert(scan.points.end(), r.points.begin(), r.points.end());
    if (surface != nullptr) surface->insert(surface->end(), r.surface.begin(), r.surface.end());
  }
  return scan;
}

}  // namespace lamina
