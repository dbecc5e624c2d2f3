// Packets of Velodyne sensors, and captures of them, byte by byte.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "core/geometry/scan.h"
#include "tests/support/files/io_test_files.h"

namespace lamina {

struct VelodyneBlock {
  std::uint16_t azimuth = 0;
  std::array<std::uint16_t, 32> distance{};
  std::array<std::uint8_t, 32> intensity{};
};
using VelodyneBlocks = std::array<VelodyneBlock, 12>;

inline std::string VelodynePacket(const VelodyneBlocks& blocks, std::uint8_t model,
                                  std::uint8_t mode, std::uint32_t us_of_hour) {
  std::string packet;
  for (const VelodyneBlock& block : blocks) {
    packet += Pack(std::uint16_t{0xEEFF}, block.azimuth);
    for (std::size_t k = 0; k < 32; ++k) packet += Pack(block.distance[k], block.intensity[k]);
  }
  return packet + Pack(us_of_hour, mode, model);
}

// The calibration of an HDL-64E: laser i is i deg up and turned by i deg.
inline std::string Hdl64eXml() {
  std::string xml = "<boost_serialization><DB><distLSB_>0.2</distLSB_><points_>";
  for (int i = 0; i < 64; ++i) {
    const auto tag = [](const std::string& name, const std::string& value) {
      return "<" + name + ">" + value + "</" + name + ">";
    };
    xml += "<item><px>" + tag("id_", std::to_string(i)) + tag("rotCorrection_", std::to_string(i)) +
           tag("vertCorrection_", std::to_string(i)) + tag("distCorrection_", "100.0") +
           tag("distCorrectionX_", "90.0") + tag("distCorrectionY_", "110.0") +
           tag("vertOffsetCorrection_", "20.0") + tag("horizOffsetCorrection_", "2.6") +
           "</px></item>\n";
  }
  return xml + "</points_></DB></boost_serialization>";
}

// Of a VLP-16: the same distance all around, from this azimuth on.
inline std::string RoundPacket(std::uint16_t azimuth, std::uint32_t us_of_hour) {
  VelodyneBlocks blocks;
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    blocks[b].azimuth = static_cast<std::uint16_t>((azimuth + 40 * b) % 36000);
    blocks[b].distance.fill(5000);
  }
  return VelodynePacket(blocks, 0x22, 0x37, us_of_hour);
}

inline std::string BigEndian(std::uint16_t value) {
  return Pack(static_cast<std::uint16_t>(value << 8U | value >> 8U));
}

// An Ethernet frame of a part of an IPv4 packet from 10.0.0.`host`; `fragment`: its flags and
// offset.
inline std::string IpFrame(const std::string& part, std::uint8_t host, std::uint16_t fragment,
                           std::uint16_t number, bool vlan = false) {
  const std::string ip =
      std::string("\x45\0", 2) + BigEndian(static_cast<std::uint16_t>(part.size() + 20)) +
      BigEndian(number) + BigEndian(fragment) + std::string("\x40\x11\0\0\x0A\0\0", 7) +
      Pack(host) + std::string("\xFF\xFF\xFF\xFF", 4);
  return std::string(12, '\1') + (vlan ? BigEndian(0x8100) + BigEndian(5) : "") +
         BigEndian(0x0800) + ip + part;
}

inline std::string UdpDatagram(const std::string& payload) {
  const auto size = static_cast<std::uint16_t>(payload.size());
  return BigEndian(2368) + BigEndian(2368) + BigEndian(static_cast<std::uint16_t>(size + 8)) +
         BigEndian(0) + payload;
}

// An Ethernet frame of a UDP packet to port 2368.
inline std::string UdpFrame(const std::string& payload, std::uint8_t host, bool vlan = false) {
  return IpFrame(UdpDatagram(payload), host, 0x4000, 0, vlan);
}

// The same in frames of an MTU of 1500 bytes.
inline std::vector<std::string> UdpFragments(const std::string& payload, std::uint8_t host,
                                             std::uint16_t number) {
  constexpr std::size_t kBytes = 1480;
  const std::string datagram = UdpDatagram(payload);
  std::vector<std::string> frames;
  for (std::size_t at = 0; at < datagram.size(); at += kBytes) {
    const unsigned more = at + kBytes < datagram.size() ? 0x2000 : 0;
    frames.push_back(IpFrame(datagram.substr(at, kBytes), host,
                             static_cast<std::uint16_t>(at / 8 | more), number));
  }
  return frames;
}

inline std::string PcapHead(bool nanoseconds) {
  return Pack(nanoseconds ? 0xA1B23C4DU : 0xA1B2C3D4U, std::uint16_t{2}, std::uint16_t{4}, 0U, 0U,
              65535U, 1U);
}

inline std::string PcapPacket(StampNs stamp_ns, const std::string& frame, bool nanoseconds) {
  const auto size = static_cast<std::uint32_t>(frame.size());
  const auto fraction = static_cast<std::uint32_t>(stamp_ns % 1000000000);
  return Pack(static_cast<std::uint32_t>(stamp_ns / 1000000000),
              nanoseconds ? fraction : fraction / 1000, size, size) +
         frame;
}

inline std::string PcapngBlock(std::uint32_t type, std::string body) {
  body.resize((body.size() + 3) / 4 * 4);
  const auto size = static_cast<std::uint32_t>(body.size() + 12);
  return Pack(type, size) + body + Pack(size);
}

inline std::string PcapngHead() {
  const std::string section =
      Pack(0x1A2B3C4DU, std::uint16_t{1}, std::uint16_t{0}, std::int64_t{-1});
  // Resolution 10^-9 s.
  const std::string interface =
      Pack(std::uint16_t{1}, std::uint16_t{0}, 65535U, std::uint16_t{9}, std::uint16_t{1}, 9U, 0U);
  return PcapngBlock(0x0A0D0D0A, section) + PcapngBlock(1, interface);
}

inline std::string PcapngPacket(StampNs stamp_ns, const std::string& frame) {
  const auto size = static_cast<std::uint32_t>(frame.size());
  return PcapngBlock(6, Pack(0U, static_cast<std::uint32_t>(stamp_ns >> 32),
                             static_cast<std::uint32_t>(stamp_ns), size, size) +
                            frame);
}

}  // namespace lamina
