#include "io/recording/capture_scans.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <map>

#include "core/base/error.h"
#include "io/message/velodyne_packet.h"

namespace lamina {
namespace {

constexpr std::size_t kMostSweeps = 1'000'000, kMostSensors = 100;
// More than any sensor sends in a turn: of one that stands still, sweeps end here.
constexpr std::uint32_t kMostPackets = 10'000;

}  // namespace

bool HoldsPackets(const std::string& path) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored)) return false;
  try {
    const RandomFile file(path);
    char head[4] = {};
    return IsPacketCapture({head, file.ReadAt(0, head, sizeof(head))});
  } catch (const InputError&) {
    return false;
  }
}

CaptureScans::CaptureScans(const std::string& path, const ScanSourceOptions& options)
    : file_(path) {
  struct Sensor {
    std::vector<Sweep> sweeps;
    std::uint64_t packets = 0;
    std::uint32_t azimuth = 0;
  };
  std::map<std::string, Sensor> sensors;
  PacketReader reader(file_);
  UdpPacket packet;
  while (reader.Next(&packet)) {
    const std::uint32_t azimuth = VelodyneAzimuth(packet.payload);
    if (azimuth >= 36000 || (sensors.size() >= kMostSensors && sensors.count(packet.source) == 0)) {
      continue;
    }
    Sensor& sensor = sensors[packet.source];
    if (sensor.packets++ == 0 || azimuth < sensor.azimuth ||
        sensor.sweeps.back().packets >= kMostPackets) {
      if (sensor.sweeps.size() >= kMostSweeps) break;
      sensor.sweeps.push_back({reader.place(), 0, packet.stamp_ns});
    }
    ++sensor.sweeps.back().packets;
    sensor.azimuth = azimuth;
  }
  format_ = reader.format();
  std::string all;
  for (const auto& [source, sensor] : sensors) {
    all += fmt::format("{}{} ({} packets)", all.empty() ? "" : ", ", source, sensor.packets);
  }
  if (all.empty()) throw InputError(fmt::format("{}: holds no packets of a Velodyne sensor", path));
  const auto chosen =
      options.topic.empty() && sensors.size() == 1 ? sensors.begin() : sensors.find(options.topic);
  if (chosen == sensors.end()) {
    throw InputError(
        fmt::format("{}: holds packets of {}; choose one by --topic NAME "
                    "(scans.topic)",
                    path, all));
  }
  source_ = chosen->first;
  sweeps_ = std::move(chosen->second.sweeps);
  described_.stamps = "the times of capture";
  if (reader.cut()) {
    described_.doubts.push_back(
        fmt::format("{}: byte {}: the file ends, or is damaged; it was read as far as it goes",
                    path, reader.place()));
  }
  std::string sensor;
  try {
    Decode(0, &sensor);
  } catch (const InputError&) {
    // Reading the scans tells.
  }
  described_.scans =
      fmt::format("{} sweeps of {} packets{}{} from {}", sweeps_.size(), chosen->second.packets,
                  sensor.empty() ? "" : " of ", sensor, source_);
}

std::string CaptureScans::Name(std::size_t i) const {
  if (i >= size()) throw std::out_of_range(fmt::format("scan {} of {}", i, size()));
  return fmt::format("{}#{}", file_.path(), i);
}

Scan CaptureScans::Decode(std::size_t i, std::string* sensor) const {
  const Sweep& sweep = sweeps_.at(i);
  PacketReader reader(file_, format_, sweep.place);
  VelodyneDecoder decoder;
  UdpPacket packet;
  Scan scan;
  for (std::uint32_t seen = 0; seen < sweep.packets && reader.Next(&packet);) {
    if (packet.source != source_ || VelodyneAzimuth(packet.payload) >= 36000) continue;
    ++seen;
    decoder.Add(packet.payload, packet.stamp_ns, Name(i), &scan);
  }
  *sensor = decoder.Describe();
  if (scan.points.empty()) throw InputError(fmt::format("{}: holds no returns", Name(i)));
  return scan;
}

Scan CaptureScans::Read(std::size_t i) const {
  std::string sensor;
  Scan scan = Decode(i, &sensor);
  scan.stamp_ns = Stamp(i);
  return scan;
}

PointTimeField CaptureScans::PointTimes(std::size_t) const {
  return {"packets", "us", false, true};
}

}  // namespace lamina
