#include "io/recording/sweep_scans.h"

#include <fmt/format.h>

#include <memory>
#include <stdexcept>

#include "core/base/error.h"

namespace lamina {

void SweepFinder::Add(const PacketSensor& sensor, std::uint32_t measured_at, std::uint64_t place,
                      StampNs stamp_ns) {
  // More than any sensor sends in a turn: of one that stands still, sweeps end here.
  constexpr std::uint32_t kMostPackets = 10'000;
  if (sweeps_.empty() || sensor.BeginsSweep(before_, measured_at) ||
      sweeps_.back().packets >= kMostPackets) {
    sweeps_.push_back({stamp_ns, place, place, 0});
  }
  sweeps_.back().last = place;
  ++sweeps_.back().packets;
  ++packets_;
  before_ = measured_at;
}

std::string SweepScans::Name(std::size_t i) const {
  if (i >= size()) throw std::out_of_range(fmt::format("scan {} of {}", i, size()));
  return fmt::format("{}#{}", path_, i);
}

Scan SweepScans::Decode(std::size_t i, std::string* described) const {
  // Four times what a sensor of 128 beams measures in a turn, two returns each.
  constexpr std::size_t kMostPoints = 2'000'000;
  const std::unique_ptr<SweepDecoder> decoder = sensor().NewSweep();
  const std::string name = Name(i);
  Scan scan;
  ForEachPacket(sweeps_[i], [&](std::string_view packet, StampNs stamp_ns) {
    decoder->Add(packet, stamp_ns, name, &scan);
    if (scan.points.size() > kMostPoints) {
      throw InputError(
          fmt::format("{}: more than {} points, which no sweep has", name, kMostPoints));
    }
  });
  *described = decoder->Describe();
  if (scan.points.empty()) throw InputError(fmt::format("{}: holds no returns", name));
  return scan;
}

Scan SweepScans::Read(std::size_t i) const {
  std::string ignored;
  Scan scan = Decode(i, &ignored);
  scan.stamp_ns = Stamp(i);
  return scan;
}

PointTimeField SweepScans::PointTimes(std::size_t) const {
  return {"packets", sensor().unit_of_times(), false, true};
}

std::string SweepScans::OfSensor() const {
  std::string sensor;
  try {
    Decode(0, &sensor);
  } catch (const InputError&) {
    // Reading the scans tells.
  }
  return sensor.empty() ? "" : " of " + sensor;
}

}  // namespace lamina
