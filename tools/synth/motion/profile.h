// How a drive departs from steady motion: the speed along the way, how the sensor turns and shakes
// on its carrier, and when the recorder writes nothing.
//
//   constant   as the scene has it: a constant speed, in a street that of a car in traffic
//   start      from rest, where it may stand for a while, with 3 m/s^2
//   brake      again and again: braking at 8 m/s^2 to a stand, 1.5 s at rest or another time, off
//              with 3 m/s^2
//   gaps       every 2 to 4 s the recorder misses 0.5 to 3 s; the scans that remain keep their
//              true stamps
//   picked     scans of which only some were kept, 1 to 5 m apart; with their true stamps, too
//   spin       the sensor turns about its z axis, by 20 deg a scan from the first second on, and
//              nods by up to 8 deg meanwhile
//   shake      at 5 Hz or so, by 1.5 deg and 2 cm about and along every axis, or otherwise
//
// `start` and `brake` bend the time of the drive: at t the sensor is where a steady drive is at
// DriveTime(t), and so is everything that moves with it. All functions are pure: thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/geometry/scan.h"
#include "core/geometry/se3.h"
#include "core/options/options.h"
#include "tools/synth/engine/random.h"
#include "tools/synth/motion/motion.h"

namespace lamina::synth {

enum class ProfileKind { kConstant, kStart, kBrake, kGaps, kPicked, kSpin, kShake };
// In the order of ProfileKind.
const std::vector<std::string>& ProfileNames();

struct ProfileOptions {
  ProfileKind kind = ProfileKind::kConstant;
  // start, brake: how long it stands before it sets off, s; brake: 1.5 for 0.
  double rest_s = 0.0;
  // Any: by how much the sensor leans forward on its carrier.
  double lean_deg = 0.0;
  // gaps: how long each of them lasts; 0: 0.5 to 3 s, drawn anew for each. Seconds.
  double gap_s = 0.0;
  // spin: degrees a scan of 0.1 s.
  double turn_deg = 20.0;
  // shake: the amplitude about each axis, along each, and how often a second.
  double shake_deg = 1.5;
  double shake_m = 0.02;
  double shake_hz = 5.0;

  void Visit(OptionVisitor& v);
};

class Profile {
 public:
  // `frames`, how many scans there are, bounds the gaps; `speed_m_per_s` is that of steady motion.
  Profile(const ProfileOptions& options, double speed_m_per_s, int frames, std::int64_t seed);

  // Seconds after which a steady drive has come as far as this one at t_s.
  double DriveTime(double t_s) const;
  // How the sensor has turned and moved on its carrier.
  SE3 T_carrier_lidar(double t_s) const;
  // Time that the recorder has missed before scan i, or that was left out.
  StampNs Missed(std::size_t i) const;

 private:
  void MissScans(int frames, HashStream* random);
  void PickScans(int frames, HashStream* random);
  SE3 Spun(double t_s) const;
  SE3 Shaken(double t_s) const;

  ProfileOptions options_;
  double speed_m_per_s_;
  double cruise_s_;                // brake: before each braking
  SE3 T_carrier_mount_;            // as it leans
  std::vector<Wobble> shake_;      // rotation about x, y, z, then along x, y, z
  std::vector<std::size_t> gaps_;  // the first scan after each
  std::vector<StampNs> missed_;    // up to and with each
};

// A motion under a profile.
class ProfiledMotion final : public Motion {
 public:
  ProfiledMotion(std::unique_ptr<Motion> steady, std::shared_ptr<const Profile> profile)
      : steady_(std::move(steady)), profile_(std::move(profile)) {}
  SE3 T_scene_lidar(double t_s) const override {
    return steady_->T_scene_lidar(profile_->DriveTime(t_s)) * profile_->T_carrier_lidar(t_s);
  }

 private:
  std::unique_ptr<Motion> steady_;
  std::shared_ptr<const Profile> profile_;
};

}  // namespace lamina::synth
