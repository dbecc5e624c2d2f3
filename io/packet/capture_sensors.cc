#include "io/packet/capture_sensors.h"

#include <fmt/format.h>

#include <filesystem>
#include <optional>

#include "core/base/error.h"
#include "io/packet/ouster_packet.h"
#include "io/packet/sensor_files.h"
#include "io/packet/velodyne_packet.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

}  // namespace

CaptureSensors::CaptureSensors(const std::string& path) {
  std::optional<Hdl64eCalibration> calibration;
  const std::string xml = FindBeside(path, {".xml"}, "db.xml");
  try {
    if (!xml.empty()) calibration = ParseHdl64eCalibration(ReadSmallFile(xml), xml);
  } catch (const InputError&) {
    // Packets of an HDL-64E then have none.
  }
  sensors_.push_back(std::make_unique<VelodyneSensor>(calibration));
  const std::string json = FindOusterMetadata(path);
  try {
    if (json.empty()) {
      metadata_ = fmt::format("{} or metadata.json must lie beside it",
                              fs::path(path).filename().replace_extension(".json").string());
    } else {
      sensors_.push_back(
          std::make_unique<OusterSensor>(ParseOusterMetadata(ReadSmallFile(json), json)));
      metadata_ = fmt::format("{} is of another sensor, or of another mode", json);
    }
  } catch (const InputError& error) {
    metadata_ = error.what();
  }
}

const PacketSensor* CaptureSensors::Find(std::string_view packet) const {
  for (const auto& sensor : sensors_) {
    if (sensor->PlaceOf(packet)) return sensor.get();
  }
  return nullptr;
}

std::string CaptureSensors::WhyNot(std::string_view packet) const {
  if (!MayBeOusterPacket(packet)) return "";
  return fmt::format(
      "packets of {} bytes are those of an Ouster sensor, which need its metadata: {}",
      packet.size(), metadata_);
}

}  // namespace lamina
