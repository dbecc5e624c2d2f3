#include "io/packet/ouster_metadata.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <initializer_list>
#include <iterator>
#include <nlohmann/json.hpp>

#include "core/base/error.h"

namespace lamina {
namespace {

using Json = nlohmann::json;

class Reader {
 public:
  Reader(const std::string& text, const std::string& name) : name_(name) {
    json_ = Json::parse(text, nullptr, false);
    if (!json_.is_object()) Fail("is no JSON object");
  }

  [[noreturn]] void Fail(const std::string& what) const {
    throw InputError(fmt::format("{}: metadata of an Ouster sensor: {}", name_, what));
  }

  // A field at the top or in one of the sections; null if it is nowhere.
  const Json* Find(const char* field, std::initializer_list<const char*> sections) const {
    const auto in = [&](const Json& object) -> const Json* {
      const auto found = object.is_object() ? object.find(field) : object.end();
      return object.is_object() && found != object.end() ? &*found : nullptr;
    };
    if (const Json* found = in(json_)) return found;
    for (const char* section : sections) {
      const auto part = json_.find(section);
      if (part == json_.end()) continue;
      if (const Json* found = in(*part)) return found;
    }
    return nullptr;
  }

  std::vector<double> Numbers(const Json& list, const char* field, std::size_t count) const {
    std::vector<double> numbers;
    if (list.is_array()) {
      for (const Json& number : list) {
        if (number.is_number()) numbers.push_back(number.get<double>());
      }
    }
    bool finite = true;
    for (const double number : numbers) finite = finite && std::isfinite(number);
    if (numbers.size() != count || !finite || numbers.size() != list.size()) {
      Fail(fmt::format("'{}' must be a list of {} numbers", field, count));
    }
    return numbers;
  }

  std::size_t Count(const Json& number, const char* field, std::size_t most) const {
    if (number.is_number_unsigned()) {
      const auto value = number.get<std::uint64_t>();
      if (value >= 1 && value <= most) return static_cast<std::size_t>(value);
    }
    Fail(fmt::format("'{}' must be a whole number from 1 to {}", field, most));
  }

  std::string Text(const char* field, std::initializer_list<const char*> sections) const {
    const Json* found = Find(field, sections);
    return found != nullptr && found->is_string() ? found->get<std::string>() : "";
  }

 private:
  const std::string& name_;
  Json json_;
};

constexpr std::initializer_list<const char*> kFormat = {"lidar_data_format", "data_format"};
constexpr std::initializer_list<const char*> kConfig = {"config_params"};
constexpr std::initializer_list<const char*> kBeamGroup = {"beam_intrinsics"};

struct ProfileName {
  OusterProfile profile;
  const char* name;
};
constexpr ProfileName kProfileNames[] = {
    {OusterProfile::kLegacy, "LEGACY"},
    {OusterProfile::kRng19Rfl8Sig16Nir16, "RNG19_RFL8_SIG16_NIR16"},
    {OusterProfile::kRng19Rfl8Sig16Nir16Dual, "RNG19_RFL8_SIG16_NIR16_DUAL"},
    {OusterProfile::kRng15Rfl8Nir8, "RNG15_RFL8_NIR8"},
    {OusterProfile::kRng15Rfl8Nir8Dual, "RNG15_RFL8_NIR8_DUAL"},
};

OusterProfile ProfileOf(const Reader& reader) {
  std::string name = reader.Text("udp_profile_lidar", kFormat);
  if (name.empty()) name = reader.Text("udp_profile_lidar", kConfig);
  if (name.empty()) return OusterProfile::kLegacy;
  if (name == "FUSA_RNG15_RFL8_NIR8_DUAL") return OusterProfile::kRng15Rfl8Nir8Dual;
  for (const ProfileName& known : kProfileNames) {
    if (name == known.name) return known.profile;
  }
  reader.Fail(fmt::format("packets of profile '{}' are not read", name));
}

// "1024x10".
std::size_t ColumnsOfMode(const Reader& reader) {
  constexpr std::size_t kMost = 4096;
  const std::string mode = reader.Text("lidar_mode", kConfig);
  const auto columns = static_cast<std::size_t>(std::strtoul(mode.c_str(), nullptr, 10));
  if (columns < 1 || columns > kMost) reader.Fail("neither 'columns_per_frame' nor 'lidar_mode'");
  return columns;
}

void ReadBeams(const Reader& reader, OusterMetadata* metadata) {
  constexpr std::size_t kMostChannels = 512, kMatrix = 16;
  constexpr double kM = 0.001;
  const Json* altitudes = reader.Find("beam_altitude_angles", kBeamGroup);
  const Json* azimuths = reader.Find("beam_azimuth_angles", kBeamGroup);
  if (altitudes == nullptr || azimuths == nullptr || altitudes->empty() ||
      altitudes->size() > kMostChannels) {
    reader.Fail("no 'beam_altitude_angles' and 'beam_azimuth_angles' of up to 512 channels");
  }
  std::size_t channels = altitudes->size();
  if (const Json* rows = reader.Find("pixels_per_column", kFormat)) {
    channels = reader.Count(*rows, "pixels_per_column", kMostChannels);
  }
  metadata->altitude_deg = reader.Numbers(*altitudes, "beam_altitude_angles", channels);
  metadata->azimuth_deg = reader.Numbers(*azimuths, "beam_azimuth_angles", channels);
  if (const Json* matrix = reader.Find("beam_to_lidar_transform", kBeamGroup)) {
    const auto m = reader.Numbers(*matrix, "beam_to_lidar_transform", kMatrix);
    metadata->origin_m = kM * m[3];
    metadata->origin_up_m = kM * m[11];
  } else if (const Json* origin = reader.Find("lidar_origin_to_beam_origin_mm", kBeamGroup)) {
    if (!origin->is_number()) reader.Fail("'lidar_origin_to_beam_origin_mm' must be a number");
    metadata->origin_m = kM * origin->get<double>();
  }
  Eigen::Matrix3d R = Eigen::Vector3d(-1.0, -1.0, 1.0).asDiagonal();
  Eigen::Vector3d t = Eigen::Vector3d::Zero();
  if (const Json* matrix = reader.Find("lidar_to_sensor_transform", {"lidar_intrinsics"})) {
    const auto m = reader.Numbers(*matrix, "lidar_to_sensor_transform", kMatrix);
    for (int r = 0; r < 3; ++r) {
      const std::size_t row = 4 * static_cast<std::size_t>(r);
      R.row(r) << m[row], m[row + 1], m[row + 2];
      t[r] = kM * m[row + 3];
    }
    if (!(R.transpose() * R).isIdentity(1e-3) || R.determinant() < 0.0) {
      reader.Fail("'lidar_to_sensor_transform' is no rotation");
    }
  }
  metadata->T_sensor_lidar = SE3(Eigen::Quaterniond(R).normalized(), t);
}

}  // namespace

const char* ToString(OusterProfile profile) {
  return std::find_if(std::begin(kProfileNames), std::end(kProfileNames),
                      [&](const ProfileName& known) { return known.profile == profile; })
      ->name;
}

OusterMetadata ParseOusterMetadata(const std::string& text, const std::string& name) {
  const Reader reader(text, name);
  constexpr std::size_t kMostColumns = 4096, kMostInPacket = 128;
  OusterMetadata metadata;
  metadata.profile = ProfileOf(reader);
  metadata.product = reader.Text("prod_line", {"sensor_info"});
  if (metadata.product.empty()) metadata.product = "OS";
  const Json* columns = reader.Find("columns_per_frame", kFormat);
  metadata.columns_per_frame = columns == nullptr
                                   ? ColumnsOfMode(reader)
                                   : reader.Count(*columns, "columns_per_frame", kMostColumns);
  if (const Json* in_packet = reader.Find("columns_per_packet", kFormat)) {
    metadata.columns_per_packet = reader.Count(*in_packet, "columns_per_packet", kMostInPacket);
  }
  ReadBeams(reader, &metadata);
  return metadata;
}

}  // namespace lamina
