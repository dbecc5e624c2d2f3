// A drive whose scans carry the time of each point, for tests of what a run makes of such times.
#pragma once

#include <string>
#include <vector>

#include "core/geometry/scan_source.h"
#include "tests/support/files/io_test_files.h"
#include "tools/synth/sequence.h"

namespace lamina {

// Scans of a drive at 10 m/s, each swept in a tenth of a second.
class SweptDrive final : public ScanSource {
 public:
  // `compensated`: points are brought to where the sensor was at the stamp, and keep their times.
  SweptDrive(std::size_t count, bool compensated) {
    SynthOptions options;
    options.frames = static_cast<int>(count);
    options.sensor = synth::SensorKind::kVlp16;
    options.sweep = true;
    const SynthSequence sequence(options);
    for (std::size_t i = 0; i < count; ++i) {
      Scan scan = sequence.Generate(i);
      const double stamp_s = 1e-9 * static_cast<double>(sequence.Stamp(i) - sequence.Stamp(0));
      poses_.push_back(sequence.TruePoseAt(stamp_s));
      const SE3 T_stamp_world = poses_.back().Inverse();
      for (std::size_t k = 0; k < scan.points.size() && compensated; ++k) {
        ScanPoint& p = scan.points[k];
        const SE3 T = T_stamp_world * sequence.TruePoseAt(stamp_s + scan.time_s[k]);
        const Eigen::Vector3d at = T * Eigen::Vector3d(p.x, p.y, p.z);
        p.x = static_cast<float>(at.x());
        p.y = static_cast<float>(at.y());
        p.z = static_cast<float>(at.z());
      }
      scans_.push_back(std::move(scan));
    }
  }

  std::size_t size() const override { return scans_.size(); }
  std::string Name(std::size_t i) const override { return std::to_string(i); }
  StampNs Stamp(std::size_t i) const override { return scans_[i].stamp_ns; }
  Scan Read(std::size_t i) const override { return scans_[i]; }
  // T_world_lidar at the stamp, in the frame of the first scan.
  const SE3& TruePose(std::size_t i) const { return poses_[i]; }

 private:
  std::vector<Scan> scans_;
  std::vector<SE3> poses_;
};

// One of 20 scans, made once.
inline const SweptDrive& LongDrive(bool compensated) {
  static const SweptDrive swept(20, false), still(20, true);
  return compensated ? still : swept;
}

// A PCD file of x, y, z (float) and a double `timestamp`, `per_s` of which are a second, `shift_s`
// later.
inline std::string TimedPcd(const Scan& scan, double shift_s, double per_s = 1.0) {
  const std::string count = std::to_string(scan.points.size());
  std::string bytes =
      "VERSION 0.7\nFIELDS x y z timestamp\nSIZE 4 4 4 8\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH " +
      count + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + count + "\nDATA binary\n";
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    const ScanPoint& p = scan.points[i];
    bytes += Pack(p.x, p.y, p.z, shift_s + per_s * static_cast<double>(scan.time_s[i]));
  }
  return bytes;
}

}  // namespace lamina
