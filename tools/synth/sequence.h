// Synthetic recordings with exact ground truth: a sensor carried through a scene, scan by scan.
//
// Scan i depends on the options and i alone, not on threads or on what was asked before; the same
// program makes the same bytes. Memory is bounded however long the recording.
//
// Points are in the LiDAR frame of their own instant, as a real sensor records them. Without
// `sweep` all rays of a scan are fired at its stamp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/scan.h"
#include "core/geometry/se3.h"
#include "core/options/options.h"
#include "io/recording/scan_source.h"
#include "tools/synth/engine/movers.h"
#include "tools/synth/engine/scene.h"
#include "tools/synth/engine/sensor.h"
#include "tools/synth/engine/sensor_errors.h"
#include "tools/synth/engine/weather.h"
#include "tools/synth/motion/motion.h"
#include "tools/synth/motion/profile.h"
#include "tools/synth/motion/route.h"

namespace lamina {

struct SynthOptions {
  int frames = 100;  // 10 a second
  synth::SensorKind sensor = synth::SensorKind::kHdl64;
  synth::SceneKind scene = synth::SceneKind::kStreet;
  int seed = 1;
  // Standard deviation of the range. Metres.
  double noise_m = 0.02;
  // Moving cars and people, beside those that belong to the scene.
  int movers = 0;
  // Fire each ray from where the sensor is at that ray's instant, at things where they are then.
  bool sweep = false;
  // Mean speed of the sensor; 0: the scene's own (street 10, hall 1.2; TrialSpeed).
  double speed_m_per_s = 0.0;
  // Street and city: where to drive, and the number of blocks along each side of a loop or, of a
  // tour, of the town.
  synth::RouteKind route = synth::RouteKind::kWinding;
  int loop_blocks = 2;
  // City: drives of other numbers begin elsewhere, go another way, and find other cars parked.
  int drive = 0;
  // Rays a scan, and beams of the sensor `spinning`; 0: the sensor's own.
  int points = 0;
  int rings = 0;
  synth::ProfileOptions profile;
  // No stamps are written, and the source gives made up ones.
  bool untimed = false;
  synth::SensorErrorOptions errors;
  synth::WeatherOptions weather;

  void Visit(OptionVisitor& v);
};

// Thread-safe: all members may be called at once.
class SynthSequence {
 public:
  // Throws OptionError naming an option's value and its rule.
  explicit SynthSequence(const SynthOptions& options);

  std::size_t size() const { return static_cast<std::size_t>(options_.frames); }
  const SynthOptions& options() const { return options_; }
  const synth::SensorModel& sensor() const { return sensor_; }

  StampNs Stamp(std::size_t i) const;

  // T_world_lidar at the stamp of scan i; the world is the LiDAR frame of scan 0.
  SE3 TruePose(std::size_t i) const;
  // The same at any instant, seconds after scan 0.
  SE3 TruePoseAt(double t_s) const;

  // Scan i. time_s is filled with `sweep`, else empty. Uses TBB's threads.
  Scan Generate(std::size_t i) const;

  // The still part of the scene around a point of the world, for distances of points to the true
  // geometry: ask the view with T_scene_world() * p_world.
  synth::SceneView ViewAround(const Eigen::Vector3d& p_world, double radius_m) const;
  SE3 T_scene_world() const { return T_scene_world_; }

  // Blocks of geometry in memory.
  std::size_t cached_blocks() const { return scene_->cached_blocks(); }

 private:
  struct Returns;
  struct FrameContext;
  void BuildStreet();
  void BuildIndoors();
  void BuildTrial();
  // What a ray brings back, if anything; its range is that of the whole way.
  std::optional<synth::SceneHit> CastRay(const FrameContext& frame,
                                         const std::vector<synth::UprightPose>& mover_poses,
                                         const Eigen::Vector3d& origin,
                                         const Eigen::Vector3d& direction, std::uint64_t key) const;
  void CastGroup(const FrameContext& frame, std::size_t group,
                 std::vector<Eigen::Vector3d>* directions, Returns* out) const;

  SynthOptions options_;
  synth::SensorModel sensor_;
  std::unique_ptr<synth::SensorErrors> errors_;
  std::shared_ptr<const synth::Profile> profile_;
  std::unique_ptr<synth::SyntheticScene> scene_;
  std::unique_ptr<synth::Motion> motion_;
  std::vector<synth::Mover> movers_;
  SE3 T_scene_world_, T_world_scene_;
};

// A synthetic sequence as a source of scans, without files.
class SynthScanSource final : public ScanSource {
 public:
  explicit SynthScanSource(std::shared_ptr<const SynthSequence> sequence);
  std::size_t size() const override { return sequence_->size(); }
  std::string Name(std::size_t i) const override;
  StampNs Stamp(std::size_t i) const override;
  bool recorded_stamps() const override { return !sequence_->options().untimed; }
  Scan Read(std::size_t i) const override;

 private:
  std::shared_ptr<const SynthSequence> sequence_;
};

}  // namespace lamina
