#include "io/recording/capture_sensors.h"

#include <fmt/format.h>

#include <filesystem>
#include <initializer_list>
#include <optional>

#include "core/base/error.h"
#include "io/file/text_input.h"
#include "io/message/ouster_packet.h"
#include "io/message/velodyne_packet.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// The first of these that is there; empty if none is.
std::string FindBeside(const std::string& path, std::initializer_list<const char*> endings,
                       const char* name) {
  const fs::path folder = fs::path(path).parent_path();
  std::error_code ignored;
  for (const char* ending : endings) {
    const fs::path file = folder / (fs::path(path).stem().string() + ending);
    if (fs::is_regular_file(file, ignored)) return file.string();
  }
  return fs::is_regular_file(folder / name, ignored) ? (folder / name).string() : "";
}

// A few kilobytes, unless it is something else.
std::string ReadSmall(const std::string& path) {
  constexpr std::uintmax_t kMostBytes = 4 << 20;
  std::error_code ignored;
  if (fs::file_size(path, ignored) > kMostBytes) {
    throw InputError(fmt::format("{}: has more than {} bytes", path, kMostBytes));
  }
  return ReadFile(path);
}

}  // namespace

CaptureSensors::CaptureSensors(const std::string& path) {
  std::optional<Hdl64eCalibration> calibration;
  const std::string xml = FindBeside(path, {".xml"}, "db.xml");
  try {
    if (!xml.empty()) calibration = ParseHdl64eCalibration(ReadSmall(xml), xml);
  } catch (const InputError&) {
    // Packets of an HDL-64E then have none.
  }
  sensors_.push_back(std::make_unique<VelodyneSensor>(calibration));
  const std::string json = FindBeside(path, {".json", "_0.json"}, "metadata.json");
  try {
    if (json.empty()) {
      metadata_ = fmt::format("{} or metadata.json must lie beside it",
                              fs::path(path).filename().replace_extension(".json").string());
    } else {
      sensors_.push_back(
          std::make_unique<OusterSensor>(ParseOusterMetadata(ReadSmall(json), json)));
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
