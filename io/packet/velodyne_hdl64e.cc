#include "io/packet/velodyne_hdl64e.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <optional>

#include "core/base/angle.h"
#include "core/base/error.h"
#include "io/packet/velodyne_packet.h"

namespace lamina {
namespace {

constexpr std::uint16_t kLower = 0xDDFF;
constexpr double kCm = 0.01;

// The number in <tag>...</tag>; nothing if there is no such tag.
std::optional<double> NumberIn(std::string_view xml, const std::string& tag,
                               const std::string& name) {
  const std::string begin = "<" + tag + ">";
  const std::size_t at = xml.find(begin);
  if (at == std::string_view::npos) return std::nullopt;
  const std::string_view rest = xml.substr(at + begin.size());
  const std::string word(rest.substr(0, rest.find('<')));
  char* end = nullptr;
  const double value = std::strtod(word.c_str(), &end);
  if (end == word.c_str() || !std::isfinite(value)) {
    throw InputError(fmt::format("{}: <{}> must be a number, found '{}'", name, tag, word));
  }
  return value;
}

double Wanted(std::string_view xml, const std::string& tag, const std::string& name) {
  const auto value = NumberIn(xml, tag, name);
  if (!value) throw InputError(fmt::format("{}: a laser has no <{}>", name, tag));
  return *value;
}

Hdl64eLaser ParseLaser(std::string_view xml, const std::string& name) {
  Hdl64eLaser laser;
  laser.rotation_deg = Wanted(xml, "rotCorrection_", name);
  laser.elevation_deg = Wanted(xml, "vertCorrection_", name);
  laser.range_m = kCm * Wanted(xml, "distCorrection_", name);
  laser.up_m = kCm * Wanted(xml, "vertOffsetCorrection_", name);
  laser.aside_m = kCm * NumberIn(xml, "horizOffsetCorrection_", name).value_or(0.0);
  // Older ones have one correction for all distances.
  const double range_cm = laser.range_m / kCm;
  laser.range_x_m = kCm * NumberIn(xml, "distCorrectionX_", name).value_or(range_cm);
  laser.range_y_m = kCm * NumberIn(xml, "distCorrectionY_", name).value_or(range_cm);
  return laser;
}

// The point of a laser in the frame of the manual: x to the right, y ahead.
Eigen::Vector3d PointOf(const Hdl64eLaser& laser, double measured_m, double azimuth_rad) {
  const double turned = azimuth_rad - kDegree * laser.rotation_deg;
  const double elevation = kDegree * laser.elevation_deg;
  const double sine = std::sin(turned), cosine = std::cos(turned);
  const auto flat = [&](double range_m) {
    return range_m * std::cos(elevation) - laser.up_m * std::sin(elevation);
  };
  const double far_m = measured_m + laser.range_m;
  double x_m = far_m, y_m = far_m;
  // Near by, the corrections go over into those of the place where they were measured.
  constexpr double kFarM = 25.0, kFarCalibratedM = 25.04, kNearXM = 2.4, kNearYM = 1.93;
  if (measured_m <= kFarM) {
    const double side = std::abs(flat(far_m) * sine - laser.aside_m * cosine);
    const double ahead = std::abs(flat(far_m) * cosine + laser.aside_m * sine);
    x_m = measured_m + laser.range_x_m +
          (laser.range_m - laser.range_x_m) * (side - kNearXM) / (kFarCalibratedM - kNearXM);
    y_m = measured_m + laser.range_y_m +
          (laser.range_m - laser.range_y_m) * (ahead - kNearYM) / (kFarCalibratedM - kNearYM);
  }
  return {flat(x_m) * sine - laser.aside_m * cosine, flat(y_m) * cosine + laser.aside_m * sine,
          y_m * std::sin(elevation) + laser.up_m * std::cos(elevation)};
}

}  // namespace

Hdl64eCalibration ParseHdl64eCalibration(const std::string& text, const std::string& name) {
  Hdl64eCalibration calibration;
  std::array<bool, Hdl64eCalibration::kLasers> found{};
  const std::string_view all = text;
  constexpr std::string_view kId = "<id_>";
  for (std::size_t at = all.find(kId); at != std::string_view::npos;) {
    const std::size_t next = all.find(kId, at + kId.size());
    const std::string_view laser =
        all.substr(at, next == std::string_view::npos ? next : next - at);
    const double id = Wanted(laser, "id_", name);
    if (!(id >= 0.0 && id < static_cast<double>(found.size()))) {
      throw InputError(fmt::format("{}: laser {} is none of 0 to 63", name, id));
    }
    const auto place = static_cast<std::size_t>(id);
    calibration.lasers[place] = ParseLaser(laser, name);
    found[place] = true;
    at = next;
  }
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (!found[i]) {
      throw InputError(
          fmt::format("{}: no calibration of an HDL-64E: laser {} is missing", name, i));
    }
  }
  const double unit_cm = NumberIn(all, "distLSB_", name).value_or(0.2);
  if (!(unit_cm > 0.0 && unit_cm <= 1.0)) {
    throw InputError(fmt::format("{}: <distLSB_> must be over 0 and up to 1 cm", name));
  }
  calibration.range_unit_m = kCm * unit_cm;
  return calibration;
}

bool IsHdl64ePacket(std::string_view packet) {
  for (std::size_t b = 0; b < kVelodyneBlocks; ++b) {
    if (VelodyneFlag(packet, b) == kLower) return true;
  }
  return false;
}

void AddHdl64ePacket(std::string_view packet, const Hdl64eCalibration& calibration, double start_s,
                     Scan* scan) {
  constexpr double kPairUs = 48.0;
  for (std::size_t b = 0; b < kVelodyneBlocks; ++b) {
    const std::uint16_t flag = VelodyneFlag(packet, b);
    if (flag != kLower && flag != kVelodyneFlag) continue;
    const double azimuth = kDegree * 0.01 * VelodyneAzimuthOf(packet, b);
    for (std::size_t k = 0; k < kVelodyneReturns; ++k) {
      const VelodyneReturn measured = VelodyneReturnAt(packet, b, k);
      if (measured.distance == 0) continue;
      const Hdl64eLaser& laser = calibration.lasers[k + (flag == kLower ? kVelodyneReturns : 0)];
      const Eigen::Vector3f p =
          PointOf(laser, measured.distance * calibration.range_unit_m, azimuth).cast<float>();
      scan->points.push_back({p.y(), -p.x(), p.z(), static_cast<float>(measured.intensity)});
      const double in_packet_us =
          kPairUs * (static_cast<double>(b / 2) +
                     static_cast<double>(k) / static_cast<double>(kVelodyneReturns));
      scan->time_s.push_back(static_cast<float>(start_s + 1e-6 * in_packet_us));
    }
  }
}

}  // namespace lamina
