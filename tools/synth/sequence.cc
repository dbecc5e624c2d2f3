#include "tools/synth/sequence.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/base/parallel.h"
#include "tools/synth/engine/random.h"
#include "tools/synth/scenes/indoor.h"
#include "tools/synth/scenes/street.h"
#include "tools/synth/scenes/trial_scenes.h"

namespace lamina {

using synth::SceneHit;
using synth::SceneKind;

namespace {

constexpr std::size_t kGroupsPerChunk = 48;
// Scans in the making may be some apart; the street needs up to 30 blocks around each.
constexpr std::size_t kMaxCachedBlocks = 64;
// Shares of the rays that a pane returns, and that it mirrors; it lets the others pass.
constexpr double kPaneReturns = 0.2, kPaneMirrors = 0.25;

double DefaultSpeed(SceneKind scene) {
  switch (scene) {
    case SceneKind::kStreet:
    case SceneKind::kCity:
      return 10.0;
    case SceneKind::kRoom:
      return 0.6;
    case SceneKind::kStairs:
      return 0.8;
    case SceneKind::kCorridor:
    case SceneKind::kHall:
      return 1.2;
    default:
      return synth::TrialSpeed(scene);
  }
}

// How vividly the sensor is moved about in the hand: see synth::ShakeOf.
double Liveliness(SceneKind scene, synth::SensorKind sensor) {
  switch (scene) {
    case SceneKind::kCorridor:
      return 0.05;
    case SceneKind::kRoom:
      return sensor == synth::SensorKind::kAvia ? 1.0 : 0.4;
    default:
      return sensor == synth::SensorKind::kAvia ? 0.5 : 0.25;
  }
}

}  // namespace

void SynthOptions::Visit(OptionVisitor& v) {
  v.Integer("frames", &frames, 1, 10000000);
  v.EnumChoice("sensor", &sensor, synth::SensorNames());
  v.EnumChoice("scene", &scene, synth::SceneNames());
  v.Integer("seed", &seed, 0, 2147483647);
  v.Number("noise_m", &noise_m, 0.0, 1.0);
  v.Integer("movers", &movers, 0, 200);
  v.Flag("sweep", &sweep);
  v.Number("speed_m_per_s", &speed_m_per_s, 0.0, 40.0);
  v.EnumChoice("route", &route, synth::RouteNames());
  v.Integer("loop_blocks", &loop_blocks, 1, 50);
  v.Integer("drive", &drive, 0, 1000000);
  v.Integer("points", &points, 0, 1000000);
  v.Integer("rings", &rings, 0, 512);
  v.Group("profile", &profile);
  v.Flag("untimed", &untimed);
  v.Group("errors", &errors);
  v.Group("weather", &weather);
}

// What one chunk of groups measured.
struct SynthSequence::Returns {
  std::vector<ScanPoint> points;
  std::vector<float> time_s;
};

// What all rays of a scan share.
struct SynthSequence::FrameContext {
  std::int64_t index;
  double stamp_s;
  synth::SceneView view;
  std::vector<const synth::Mover*> movers;  // in reach
};

SynthSequence::SynthSequence(const SynthOptions& options)
    : options_(options), sensor_(options.sensor, options.points, options.rings) {
  CheckOptions(options, "synth");
  if (options_.speed_m_per_s == 0.0) options_.speed_m_per_s = DefaultSpeed(options_.scene);
  errors_ = std::make_unique<synth::SensorErrors>(options_.errors, sensor_.rays_per_group(),
                                                  options_.seed);
  profile_ = std::make_shared<const synth::Profile>(options_.profile, options_.speed_m_per_s,
                                                    options_.frames, options_.seed);
  if (options_.scene == SceneKind::kStreet || options_.scene == SceneKind::kCity) {
    BuildStreet();
  } else if (synth::IsTrialScene(options_.scene)) {
    BuildTrial();
  } else {
    BuildIndoors();
  }
  if (options_.profile.kind != synth::ProfileKind::kConstant) {
    motion_ = std::make_unique<synth::ProfiledMotion>(std::move(motion_), profile_);
  }
  T_scene_world_ = motion_->T_scene_lidar(0.0);
  T_world_scene_ = T_scene_world_.Inverse();
}

void SynthSequence::BuildStreet() {
  auto model = options_.scene == SceneKind::kCity
                   ? std::make_unique<synth::StreetModel>(options_.seed, options_.drive)
                   : std::make_unique<synth::StreetModel>(options_.seed);
  const synth::Terrain terrain = model->terrain();
  const auto route =
      std::make_shared<const synth::Route>(options_.route, options_.loop_blocks, model->BlockSize(),
                                           synth::HashOf({options_.seed, options_.drive}));
  const auto drive = std::make_shared<const synth::DriveProfile>(*route, options_.speed_m_per_s);
  scene_ = std::make_unique<synth::SyntheticScene>(std::move(model), kMaxCachedBlocks);
  motion_ = std::make_unique<synth::CarMotion>(terrain, route, drive, options_.seed);
  movers_ = synth::MakeTraffic(options_.movers, terrain, route, drive, options_.speed_m_per_s,
                               options_.seed);
}

void SynthSequence::BuildIndoors() {
  std::unique_ptr<synth::SceneModel> model;
  switch (options_.scene) {
    case SceneKind::kRoom:
      model = synth::MakeRoom(options_.seed);
      break;
    case SceneKind::kStairs:
      model = synth::MakeStairs(options_.seed);
      break;
    case SceneKind::kHall:
      model = synth::MakeHall(options_.seed);
      break;
    default:
      model = synth::MakeCorridor();
      break;
  }
  scene_ = std::make_unique<synth::SyntheticScene>(std::move(model), kMaxCachedBlocks);
  const auto path = synth::MakeIndoorPath(options_.scene, options_.speed_m_per_s);
  motion_ = std::make_unique<synth::HandheldMotion>(
      path, synth::ShakeOf(Liveliness(options_.scene, options_.sensor)), options_.seed);
  movers_ = synth::MakeCompany(options_.movers, path, synth::kSensorInHand, options_.speed_m_per_s,
                               options_.seed);
}

void SynthSequence::BuildTrial() {
  synth::TrialScene trial =
      synth::MakeTrialScene(options_.scene, options_.speed_m_per_s, options_.seed);
  scene_ = std::make_unique<synth::SyntheticScene>(std::move(trial.model), kMaxCachedBlocks);
  motion_ = std::make_unique<synth::HandheldMotion>(trial.path, trial.shake, options_.seed);
  movers_ = std::move(trial.movers);
}

StampNs SynthSequence::Stamp(std::size_t i) const {
  return static_cast<StampNs>(i) * std::llround(1e9 * sensor_.period_s()) + profile_->Missed(i);
}

SE3 SynthSequence::TruePose(std::size_t i) const {
  if (i == 0) return SE3();  // without rounding
  return TruePoseAt(SecondsBetween(0, Stamp(i)));
}

SE3 SynthSequence::TruePoseAt(double t_s) const {
  return T_world_scene_ * motion_->T_scene_lidar(t_s);
}

synth::SceneView SynthSequence::ViewAround(const Eigen::Vector3d& p_world, double radius_m) const {
  return scene_->ViewAround(T_scene_world_ * p_world, radius_m);
}

std::optional<SceneHit> SynthSequence::CastRay(const FrameContext& frame,
                                               const std::vector<synth::UprightPose>& mover_poses,
                                               const Eigen::Vector3d& origin,
                                               const Eigen::Vector3d& direction,
                                               std::uint64_t key) const {
  const double max_range = sensor_.max_range_m();
  constexpr int kMostPanes = 4;
  Eigen::Vector3d from = origin, along = direction;
  double way = 0.0;
  for (int panes = 0;; ++panes) {
    std::optional<SceneHit> hit = frame.view.Cast(from, along, max_range - way);
    for (std::size_t m = 0; m < frame.movers.size(); ++m) {
      const double nearer = hit ? hit->range_m : max_range - way;
      const auto closer = frame.movers[m]->Cast(mover_poses[m], from, along, nearer);
      if (closer) hit = closer;
    }
    if (!hit) return std::nullopt;
    const bool is_pane = hit->material == synth::Material::kPane;
    const double chance =
        is_pane ? synth::UniformFrom(synth::HashOf({static_cast<std::int64_t>(key), 0x9a4e, panes}))
                : 0.0;
    if (!is_pane || chance < kPaneReturns || panes == kMostPanes) {
      hit->range_m += way;
      return hit;
    }
    // Beyond the pane, or back from it.
    constexpr double kClearM = 1e-3;
    const Eigen::Vector3d normal = hit->normal.cast<double>();
    way += hit->range_m;
    from += hit->range_m * along;
    if (chance < kPaneReturns + kPaneMirrors) along -= 2.0 * along.dot(normal) * normal;
    from += kClearM * along;
  }
}

void SynthSequence::CastGroup(const FrameContext& frame, std::size_t group,
                              std::vector<Eigen::Vector3d>* directions, Returns* out) const {
  if (errors_->IsDropped(frame.index, group, sensor_.groups())) return;
  const double since_stamp = options_.sweep ? sensor_.TimeOf(frame.index, group) : 0.0;
  const double t = frame.stamp_s + since_stamp;
  const SE3 T_scene_lidar = motion_->T_scene_lidar(t);
  const Eigen::Matrix3d R = T_scene_lidar.R();
  sensor_.Directions(frame.index, group, directions);
  std::vector<synth::UprightPose> mover_poses;
  mover_poses.reserve(frame.movers.size());
  for (const synth::Mover* mover : frame.movers) {
    mover_poses.push_back(mover->At(profile_->DriveTime(t)));
  }
  const auto add = [&](const Eigen::Vector3d& direction, double range, float intensity) {
    const Eigen::Vector3f p = (range * direction).cast<float>();
    out->points.push_back({p.x(), p.y(), p.z(), intensity});
    if (!options_.sweep) return;
    out->time_s.push_back(static_cast<float>(since_stamp + errors_->time_offset_s()));
  };
  for (std::size_t ray = 0; ray < directions->size(); ++ray) {
    const auto number = static_cast<std::int64_t>(group * directions->size() + ray);
    const std::uint64_t key = synth::HashOf({options_.seed, frame.index, number});
    const Eigen::Vector3d direction = R * errors_->Fired(ray, (*directions)[ray]);
    const std::optional<SceneHit> hit =
        CastRay(frame, mover_poses, T_scene_lidar.t, direction, key);
    const auto drop = synth::DropRange(options_.weather, frame.index, key);
    if (drop && (!hit || *drop < hit->range_m || options_.weather.IsSpray(frame.index))) {
      add((*directions)[ray], *drop, 0.0F);
      continue;
    }
    if (!hit || hit->range_m < sensor_.min_range_m()) continue;
    const double cosine = std::abs(hit->normal.cast<double>().dot(direction));
    if (!synth::IsReturned(hit->material, hit->range_m, cosine, sensor_.max_range_m(),
                           synth::UniformFrom(synth::ScrambleBits(key)))) {
      continue;
    }
    add((*directions)[ray],
        hit->range_m + errors_->RangeBias(ray, cosine) +
            options_.noise_m * synth::GaussianFrom(key),
        synth::IntensityOf(hit->material, cosine));
  }
}

Scan SynthSequence::Generate(std::size_t i) const {
  FrameContext frame;
  frame.index = static_cast<std::int64_t>(i);
  frame.stamp_s = SecondsBetween(0, Stamp(i));
  const Eigen::Vector3d here = motion_->T_scene_lidar(frame.stamp_s).t;
  // A sweep moves the sensor by some metres at most.
  const double reach = sensor_.max_range_m() + 5.0;
  frame.view = scene_->ViewAround(here, reach);
  for (const synth::Mover& mover : movers_) {
    if ((mover.At(profile_->DriveTime(frame.stamp_s)).position - here).norm() < reach + 10.0) {
      frame.movers.push_back(&mover);
    }
  }
  std::vector<Returns> chunks((sensor_.groups() + kGroupsPerChunk - 1) / kGroupsPerChunk);
  ParallelChunks(sensor_.groups(), kGroupsPerChunk, [&](std::size_t begin, std::size_t end) {
    Returns& out = chunks[begin / kGroupsPerChunk];
    out.points.reserve(kGroupsPerChunk * sensor_.rays_per_group());
    std::vector<Eigen::Vector3d> directions;
    for (std::size_t group = begin; group < end; ++group) {
      CastGroup(frame, group, &directions, &out);
    }
  });
  Scan scan;
  scan.stamp_ns = Stamp(i);
  for (const Returns& chunk : chunks) {
    scan.points.insert(scan.points.end(), chunk.points.begin(), chunk.points.end());
    scan.time_s.insert(scan.time_s.end(), chunk.time_s.begin(), chunk.time_s.end());
  }
  return scan;
}

SynthScanSource::SynthScanSource(std::shared_ptr<const SynthSequence> sequence)
    : sequence_(std::move(sequence)) {}

StampNs SynthScanSource::Stamp(std::size_t i) const {
  return recorded_stamps() ? sequence_->Stamp(i) : MadeUpStamp(i, ScanSourceOptions());
}

Scan SynthScanSource::Read(std::size_t i) const {
  Scan scan = sequence_->Generate(i);
  scan.stamp_ns = Stamp(i);
  scan.stamp_made_up = !recorded_stamps();
  return scan;
}

std::string SynthScanSource::Name(std::size_t i) const {
  return fmt::format("synthetic scan {}", i);
}

}  // namespace lamina
