#include "io/recording/capture_scans.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "core/base/error.h"
#include "core/base/first_readable.h"

namespace lamina {
namespace {

constexpr std::size_t kMostSweeps = 1'000'000, kMostSensors = 100;

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
    : SweepScans(path), file_(path), sensors_(path) {
  std::map<std::string, Source> sources = FindSources();
  std::string all;
  for (const auto& [name, source] : sources) {
    all += fmt::format("{}{} ({} packets)", all.empty() ? "" : ", ", name, source.found.packets());
  }
  const auto chosen =
      options.topic.empty() && sources.size() == 1 ? sources.begin() : sources.find(options.topic);
  if (chosen == sources.end()) {
    throw InputError(
        fmt::format("{}: holds packets of {}; choose one by --topic NAME "
                    "(scans.topic)",
                    path, all));
  }
  source_ = chosen->first;
  sensor_ = chosen->second.sensor;
  sweeps_ = std::move(chosen->second.found.sweeps());
  CheckFirstPackets();
  described_.stamps = "the times of capture";
  described_.scans = fmt::format("{} sweeps of {} packets{} from {}", sweeps_.size(),
                                 chosen->second.found.packets(), OfSensor(), source_);
}

std::map<std::string, CaptureScans::Source> CaptureScans::FindSources() {
  std::map<std::string, Source> sources;
  PacketReader reader(file_);
  UdpPacket packet;
  std::string why_not;
  while (reader.Next(&packet)) {
    const PacketSensor* sensor = sensors_.Find(packet.payload);
    if (sensor == nullptr && why_not.empty()) why_not = sensors_.WhyNot(packet.payload);
    if (sensor == nullptr ||
        (sources.size() >= kMostSensors && sources.count(packet.source) == 0)) {
      continue;
    }
    Source& source = sources[packet.source];
    if (source.sensor == nullptr) source.sensor = sensor;
    if (source.sensor != sensor) continue;
    source.found.Add(*sensor, *sensor->PlaceOf(packet.payload), reader.place(), packet.stamp_ns);
    if (source.found.sweeps().size() > kMostSweeps) {
      source.found.sweeps().pop_back();
      break;
    }
  }
  format_ = reader.format();
  if (reader.cut()) {
    described_.doubts.push_back(
        fmt::format("{}: byte {}: the file ends, or is damaged; it was read as far as it goes",
                    file_.path(), reader.place()));
  }
  if (sources.empty()) {
    throw InputError(fmt::format("{}: holds no packets of a Velodyne or Ouster sensor{}{}",
                                 file_.path(), why_not.empty() ? "" : "; ", why_not));
  }
  return sources;
}

// Throws InputError if none of the first ones can be read: that of its sensor is missing.
void CaptureScans::CheckFirstPackets() const {
  const std::size_t tries = std::min(kReadTries, sweeps_.size());
  for (std::size_t i = 0; i < tries; ++i) {
    PacketReader reader(file_, format_, sweeps_[i].place);
    UdpPacket packet;
    Scan ignored;
    try {
      if (reader.Next(&packet)) {
        sensor_->NewSweep()->Add(packet.payload, packet.stamp_ns, file_.path(), &ignored);
      }
      return;
    } catch (const InputError&) {
      if (i + 1 == tries) throw;
    }
  }
}

void CaptureScans::ForEachPacket(const Sweep& sweep, const UsePacket& use) const {
  PacketReader reader(file_, format_, sweep.place);
  UdpPacket packet;
  for (std::uint32_t seen = 0; seen < sweep.packets && reader.Next(&packet);) {
    if (packet.source != source_ || !sensor_->PlaceOf(packet.payload)) continue;
    ++seen;
    use(packet.payload, packet.stamp_ns);
  }
}

}  // namespace lamina
