// Packets and metadata of Ouster's sensors, byte by byte.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "tests/support/files/io_test_files.h"

namespace lamina {

inline constexpr int kOusterColumns = 64;  // a frame

// A sensor of `channels` channels: channel i at -10 deg + i, turned aside by i deg; 16 columns a
// packet. `sections`: as firmware since 2.4 writes it.
inline std::string OusterMetadataText(const std::string& profile, int channels, bool sections) {
  std::string altitudes, azimuths;
  for (int i = 0; i < channels; ++i) {
    altitudes += (i > 0 ? ", " : "") + std::to_string(i - 10);
    azimuths += (i > 0 ? ", " : "") + std::to_string(i);
  }
  const std::string beams = R"("beam_altitude_angles": [)" + altitudes +
                            R"(], "beam_azimuth_angles": [)" + azimuths +
                            R"(], "lidar_origin_to_beam_origin_mm": 20.0)";
  const std::string format = R"("columns_per_frame": )" + std::to_string(kOusterColumns) +
                             R"(, "columns_per_packet": 16, "pixels_per_column": )" +
                             std::to_string(channels) + R"(, "udp_profile_lidar": ")" + profile +
                             "\"";
  const std::string frame =
      R"("lidar_to_sensor_transform": [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36.0, 0, 0, 0, 1])";
  if (!sections) {
    return "{" + beams + ", \"data_format\": {" + format + "}, " + frame +
           R"(, "lidar_mode": "1024x10", "prod_line": "OS-1-16"})";
  }
  return R"({"beam_intrinsics": {)" + beams + R"(}, "lidar_data_format": {)" + format +
         R"(}, "lidar_intrinsics": {)" + frame + R"(}, "sensor_info": {"prod_line": "OS-1-16"}})";
}

// The bytes of one channel, by column and channel.
using OusterChannel = std::function<std::string(int column, int channel)>;

// Columns [first, first + 16) of a frame; a column is measured 0.1 ms behind the one before, and
// every 16th is not valid.
inline std::string OusterPacket(bool legacy, std::uint16_t frame, int first, int channels,
                                const OusterChannel& channel) {
  std::string packet = legacy ? "" : Pack(std::uint16_t{1}, frame) + std::string(28, '\x5A');
  for (int c = first; c < first + 16; ++c) {
    const bool valid = c % 16 != 15;
    const auto column = static_cast<std::uint16_t>(c);
    const std::uint64_t ns =
        7'000'000'000ULL + 100'000ULL * static_cast<unsigned>(frame * kOusterColumns + c);
    packet += Pack(ns, column);
    packet += legacy ? Pack(frame, std::uint32_t{0}) : Pack(static_cast<std::uint16_t>(valid));
    for (int i = 0; i < channels; ++i) packet += channel(c, i);
    if (legacy) packet += Pack(valid ? 0xFFFFFFFFU : 0U);
  }
  return packet + (legacy ? "" : std::string(32, '\x5A'));
}

}  // namespace lamina
