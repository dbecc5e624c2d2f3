// How the sensor moves through a scene: poses for any instant, smooth in time.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/geometry/se3.h"
#include "tools/synth/motion/route.h"
#include "tools/synth/scenes/ground.h"

namespace lamina::synth {

// Sum of sinusoids with hashed phases: sum_k amplitude_k sin(2 pi f_k t + phase_k).
class Wobble {
 public:
  struct Wave {
    double amplitude, frequency_hz;
  };
  Wobble(const std::vector<Wave>& waves, std::uint64_t key);
  double At(double t_s) const;

 private:
  struct Term {
    double amplitude, rate, phase;
  };
  std::vector<Term> terms_;
};

// Implementations are immutable: thread-safe.
class Motion {
 public:
  virtual ~Motion() = default;
  // The pose at any instant, negative ones included.
  virtual SE3 T_scene_lidar(double t_s) const = 0;
};

// A sensor on the roof of a car in the right lane: z follows the ground, the body pitches with
// slope and acceleration and rolls in curves.
class CarMotion final : public Motion {
 public:
  CarMotion(const Terrain& terrain, std::shared_ptr<const Route> route,
            std::shared_ptr<const DriveProfile> drive, std::int64_t seed);
  SE3 T_scene_lidar(double t_s) const override;

 private:
  Terrain terrain_;
  std::shared_ptr<const Route> route_;
  std::shared_ptr<const DriveProfile> drive_;
  Wobble pitch_, roll_, heave_;
  double lane_phase_;
};

// Something that stands upright somewhere, turned by `yaw` (rad) about z.
struct UprightPose {
  Eigen::Vector3d position;
  double yaw = 0.0;
};

// Where a walker or a car is at any instant. Implementations are immutable: thread-safe.
class UprightPath {
 public:
  virtual ~UprightPath() = default;
  virtual UprightPose At(double t_s) const = 0;
};

// How a sensor shakes and looks around in a hand: waves added to the carrier's position (m) and
// yaw, pitch and roll (rad).
struct HandheldShake {
  std::vector<Wobble::Wave> x, y, z, yaw, pitch, roll;
};
// `liveliness` scales the rotations: 1 turns by up to some 10 deg in 0.1 s.
HandheldShake ShakeOf(double liveliness);

// A sensor in the hand of someone who follows a path; the path has the height of the sensor.
class HandheldMotion final : public Motion {
 public:
  HandheldMotion(std::shared_ptr<const UprightPath> path, const HandheldShake& shake,
                 std::int64_t seed);
  SE3 T_scene_lidar(double t_s) const override;

 private:
  std::shared_ptr<const UprightPath> path_;
  Wobble x_, y_, z_, yaw_, pitch_, roll_;
};

}  // namespace lamina::synth
