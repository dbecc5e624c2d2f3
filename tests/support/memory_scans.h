// A recording that lives in memory, for tests.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "core/geometry/scan_source.h"

namespace lamina {

class MemoryScans final : public ScanSource {
 public:
  explicit MemoryScans(std::vector<Scan> scans) : scans_(std::move(scans)) {}
  std::size_t size() const override { return scans_.size(); }
  std::string Name(std::size_t i) const override { return "scan " + std::to_string(i); }
  StampNs Stamp(std::size_t i) const override { return scans_.at(i).stamp_ns; }
  Scan Read(std::size_t i) const override { return scans_.at(i); }

 private:
  std::vector<Scan> scans_;
};

inline ScanPoint ToScanPoint(const Eigen::Vector3d& p, float intensity = 0.0F) {
  const Eigen::Vector3f f = p.cast<float>();
  return {f.x(), f.y(), f.z(), intensity};
}

}  // namespace lamina
