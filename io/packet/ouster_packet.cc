// Ouster Firmware User Manual, "Lidar Data": columns of a packet, little-endian.
//
//   LEGACY   a column: u64 ns, u16 number of the column, u16 number of the frame, u32 encoder, then
//            12 bytes a channel, and a u32 that is all ones if the column is valid
//   others   32 bytes, of which u16 at 2 is the number of the frame; a column: u64 ns, u16 its
//            number, u16 status (bit 0: valid), then the channels; 32 bytes at the end
//
// The first word of a channel has the range in its lower bits, in mm, or in 8 mm for RNG15. The
// beam of channel i in column c, with range r, turns clockwise (theta), from an origin n beside the
// axis:
//
//   theta = 2 pi (1 - c / columns)    azimuth = theta - azimuth_i    phi = altitude_i
//   p_lidar = (r - |n|) (cos(azimuth) cos(phi), sin(azimuth) cos(phi), sin(phi))
//             + (n cos(theta), n sin(theta), n_up)
#include "io/packet/ouster_packet.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <iterator>
#include <utility>

#include "core/base/angle.h"
#include "io/file/byte_numbers.h"

namespace lamina {
namespace {

struct OusterReturn {
  std::size_t range_at = 0, intensity_at = 0;
};

// Where things are in a packet and its columns, in bytes.
struct PacketFrame {
  std::size_t packet_head, column_head, column_tail, packet_tail, frame_at;
};
constexpr PacketFrame kLegacy = {0, 16, 4, 0, 10};
constexpr PacketFrame kFrame = {32, 12, 0, 32, 2};  // of all others

struct RangeWord {
  std::uint32_t mask;
  double unit_m;
};
constexpr RangeWord kRng20 = {0xFFFFF, 0.001};
constexpr RangeWord kRng19 = {0x7FFFF, 0.001};
constexpr RangeWord kRng15 = {0x7FFF, 0.008};

struct ProfileLayout {
  OusterProfile profile;
  PacketFrame frame;
  RangeWord range;
  // Bytes of a channel, and of its intensity: the signal, or the reflectivity where there is none.
  std::size_t channel_bytes, intensity_bytes;
  std::size_t returns;
  OusterReturn first, second;
};

using Profile = OusterProfile;
constexpr ProfileLayout kLayouts[] = {
    {Profile::kLegacy, kLegacy, kRng20, 12, 2, 1, {0, 6}, {}},
    {Profile::kRng19Rfl8Sig16Nir16, kFrame, kRng19, 12, 2, 1, {0, 6}, {}},
    {Profile::kRng19Rfl8Sig16Nir16Dual, kFrame, kRng19, 16, 2, 2, {0, 8}, {4, 10}},
    {Profile::kRng15Rfl8Nir8, kFrame, kRng15, 4, 1, 1, {0, 2}, {}},
    {Profile::kRng15Rfl8Nir8Dual, kFrame, kRng15, 8, 1, 2, {0, 2}, {4, 6}},
};

const ProfileLayout& LayoutOf(OusterProfile profile) {
  return *std::find_if(std::begin(kLayouts), std::end(kLayouts),
                       [&](const ProfileLayout& layout) { return layout.profile == profile; });
}

std::size_t ColumnBytes(const ProfileLayout& layout, std::size_t channels) {
  return layout.frame.column_head + channels * layout.channel_bytes + layout.frame.column_tail;
}

std::size_t PacketBytes(const ProfileLayout& layout, std::size_t columns, std::size_t channels) {
  return layout.frame.packet_head + columns * ColumnBytes(layout, channels) +
         layout.frame.packet_tail;
}

class OusterSweep final : public SweepDecoder {
 public:
  OusterSweep(const OusterMetadata& metadata, std::size_t packet_bytes)
      : metadata_(metadata), layout_(LayoutOf(metadata.profile)), packet_bytes_(packet_bytes) {
    for (const double altitude_deg : metadata.altitude_deg) {
      sine_.push_back(std::sin(kDegree * altitude_deg));
      cosine_.push_back(std::cos(kDegree * altitude_deg));
    }
  }

  void Add(std::string_view packet, StampNs, const std::string&, Scan* scan) override {
    if (packet.size() != packet_bytes_) return;
    seen_ = true;
    const std::size_t bytes = ColumnBytes(layout_, sine_.size());
    for (std::size_t c = 0; c < metadata_.columns_per_packet; ++c) {
      AddColumn(packet.substr(layout_.frame.packet_head + c * bytes, bytes), scan);
    }
  }

  std::string Describe() const override {
    return seen_ ? fmt::format("{}, {}", metadata_.product, ToString(layout_.profile)) : "";
  }

 private:
  bool IsValid(std::string_view column) const {
    if (layout_.profile != OusterProfile::kLegacy) {
      return (NumberAt<std::uint16_t>(column, 10) & 1U) != 0;
    }
    return NumberAt<std::uint32_t>(column, column.size() - layout_.frame.column_tail) ==
           0xFFFFFFFFU;
  }

  void AddColumn(std::string_view column, Scan* scan) {
    const auto number = NumberAt<std::uint16_t>(column, 8);
    if (!IsValid(column) || number >= metadata_.columns_per_frame) return;
    const auto ns = NumberAt<std::uint64_t>(column, 0);
    if (!first_ns_) first_ns_ = ns;
    // Of one sweep, also where its packets change their order.
    constexpr double kMostS = 1.0;
    const double time_s = 1e-9 * (ns >= *first_ns_ ? static_cast<double>(ns - *first_ns_)
                                                   : -static_cast<double>(*first_ns_ - ns));
    if (std::abs(time_s) > kMostS) return;
    const double theta =
        2.0 * M_PI *
        (1.0 - static_cast<double>(number) / static_cast<double>(metadata_.columns_per_frame));
    const Eigen::Vector3d origin(metadata_.origin_m * std::cos(theta),
                                 metadata_.origin_m * std::sin(theta), metadata_.origin_up_m);
    for (std::size_t i = 0; i < sine_.size(); ++i) {
      const std::string_view channel = column.substr(
          layout_.frame.column_head + i * layout_.channel_bytes, layout_.channel_bytes);
      const std::uint32_t first = RangeOf(channel, layout_.first);
      const double azimuth = theta - kDegree * metadata_.azimuth_deg[i];
      const Eigen::Vector3d beam(std::cos(azimuth) * cosine_[i], std::sin(azimuth) * cosine_[i],
                                 sine_[i]);
      AddReturn(first, channel, layout_.first, beam, origin, time_s, scan);
      if (layout_.returns < 2) continue;
      const std::uint32_t second = RangeOf(channel, layout_.second);
      if (second != first) {
        AddReturn(second, channel, layout_.second, beam, origin, time_s, scan);
      }
    }
  }

  std::uint32_t RangeOf(std::string_view channel, const OusterReturn& at) const {
    std::uint32_t word = 0;
    std::memcpy(&word, channel.data() + at.range_at,
                std::min(sizeof(word), channel.size() - at.range_at));
    return word & layout_.range.mask;
  }

  void AddReturn(std::uint32_t range, std::string_view channel, const OusterReturn& at,
                 const Eigen::Vector3d& beam, const Eigen::Vector3d& origin, double time_s,
                 Scan* scan) const {
    if (range == 0) return;
    const double n = std::hypot(metadata_.origin_m, metadata_.origin_up_m);
    const Eigen::Vector3d p_lidar = (range * layout_.range.unit_m - n) * beam + origin;
    const Eigen::Vector3f p = (metadata_.T_sensor_lidar * p_lidar).cast<float>();
    const float intensity = layout_.intensity_bytes == 1
                                ? NumberAt<std::uint8_t>(channel, at.intensity_at)
                                : NumberAt<std::uint16_t>(channel, at.intensity_at);
    scan->points.push_back({p.x(), p.y(), p.z(), intensity});
    scan->time_s.push_back(static_cast<float>(time_s));
  }

  const OusterMetadata& metadata_;
  const ProfileLayout& layout_;
  const std::size_t packet_bytes_;
  std::vector<double> sine_, cosine_;
  std::optional<std::uint64_t> first_ns_;
  bool seen_ = false;
};

}  // namespace

OusterSensor::OusterSensor(OusterMetadata metadata) : metadata_(std::move(metadata)) {
  packet_bytes_ = PacketBytes(LayoutOf(metadata_.profile), metadata_.columns_per_packet,
                              metadata_.altitude_deg.size());
}

std::optional<std::uint32_t> OusterSensor::PlaceOf(std::string_view packet) const {
  if (packet.size() != packet_bytes_) return std::nullopt;
  return PlaceInHead(packet);
}

std::uint32_t OusterSensor::PlaceInHead(std::string_view head) const {
  return NumberAt<std::uint16_t>(head, LayoutOf(metadata_.profile).frame.frame_at);
}

bool OusterSensor::BeginsSweep(std::uint32_t before, std::uint32_t now) const {
  // Numbers begin again behind 65535. A packet that comes late belongs to the sweep before, and is
  // taken into this one.
  const std::uint32_t ahead = (now - before) & 0xFFFFU;
  return ahead > 0 && ahead < 0x8000U;
}

std::unique_ptr<SweepDecoder> OusterSensor::NewSweep() const {
  return std::make_unique<OusterSweep>(metadata_, packet_bytes_);
}

bool MayBeOusterPacket(std::string_view packet) {
  constexpr std::size_t kColumns = 16;
  for (const ProfileLayout& layout : kLayouts) {
    for (const std::size_t channels : {16U, 32U, 64U, 128U}) {
      if (packet.size() == PacketBytes(layout, kColumns, channels)) return true;
    }
  }
  return false;
}

}  // namespace lamina
