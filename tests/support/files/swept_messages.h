// Swept scans of a drive through a street, and messages of them.
#pragma once

#include <string>
#include <vector>

#include "core/geometry/scan.h"
#include "tests/support/files/container_files.h"
#include "tools/synth/sequence.h"

namespace lamina {

// Twelve of a VLP-16; made once for all tests of a program.
inline const std::vector<Scan>& SweptScans() {
  constexpr StampNs kFirst = 1'700'000'000'000'000'000;
  static const std::vector<Scan> scans = [] {
    SynthOptions options;
    options.frames = 12;
    options.sensor = synth::SensorKind::kVlp16;
    options.sweep = true;
    const SynthSequence sequence(options);
    std::vector<Scan> all;
    for (std::size_t i = 0; i < sequence.size(); ++i) {
      all.push_back(sequence.Generate(i));
      all.back().stamp_ns += kFirst;
    }
    return all;
  }();
  return scans;
}

// On /points, with a second topic of them if that has a name.
inline RecordedMessages SweptMessages(WireWriter::Form form, const std::string& other = "") {
  RecordedMessages recorded;
  recorded.topics = {{"/imu", "sensor_msgs/Imu"}, {"/points", "sensor_msgs/PointCloud2"}};
  if (!other.empty()) recorded.topics.push_back({other, "sensor_msgs/PointCloud2"});
  for (const Scan& scan : SweptScans()) {
    const StampNs log = scan.stamp_ns + 105'000'000;
    recorded.messages.push_back({0, log, "imu"});
    recorded.messages.push_back({1, log, CloudMessage(form, scan.stamp_ns, scan)});
    if (!other.empty()) recorded.messages.push_back({2, log, recorded.messages.back().bytes});
  }
  return recorded;
}

}  // namespace lamina
