#include "io/packet/packet_capture.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/base/error.h"
#include "io/file/byte_numbers.h"

namespace lamina {
namespace {

constexpr std::uint32_t kMicroseconds = 0xA1B2C3D4, kNanoseconds = 0xA1B23C4D;
constexpr std::uint32_t kSectionHeader = 0x0A0D0D0A, kByteOrder = 0x1A2B3C4D;
constexpr std::uint32_t kInterface = 1, kSimplePacket = 3, kEnhancedPacket = 6;
constexpr std::uint32_t kMostPacketBytes = 1 << 20;
constexpr std::size_t kMostInterfaces = 1000;

// Numbers in headers of the network are big-endian.
std::uint16_t BigAt(std::string_view bytes, std::size_t at) {
  return NumberAt<std::uint16_t>(bytes, at, true);
}

// Where IPv4 begins in a frame; nothing if it holds something else.
std::optional<std::string_view> IpOf(std::string_view frame, std::uint32_t link) {
  constexpr std::uint32_t kEthernet = 1, kRawIp = 101, kRawIpV4 = 228, kCooked = 113,
                          kCooked2 = 276;
  constexpr std::uint16_t kIpV4 = 0x0800, kVlan = 0x8100, kVlan2 = 0x88A8;
  std::size_t head = 0, type_at = 0;
  if (link == kRawIp || link == kRawIpV4) return frame;
  if (link == kEthernet) head = 14, type_at = 12;
  if (link == kCooked) head = 16, type_at = 14;
  if (link == kCooked2) head = 20, type_at = 0;
  if (head == 0 || frame.size() < head) return std::nullopt;
  std::uint16_t type = BigAt(frame, type_at);
  while ((type == kVlan || type == kVlan2) && link == kEthernet && frame.size() >= head + 4) {
    type = BigAt(frame, head + 2);
    head += 4;
  }
  if (type != kIpV4) return std::nullopt;
  return frame.substr(head);
}

}  // namespace

bool IsPacketCapture(std::string_view head) {
  if (head.size() < sizeof(std::uint32_t)) return false;
  const auto magic = NumberAt<std::uint32_t>(head, 0);
  for (const std::uint32_t known : {kMicroseconds, kNanoseconds}) {
    if (magic == known || magic == Swapped(known)) return true;
  }
  return magic == kSectionHeader;
}

PacketReader::PacketReader(const RandomFile& file)
    : file_(file), begin_(0), stream_(file, 0, file.size(), 1 << 16) {
  ReadHead();
}

PacketReader::PacketReader(const RandomFile& file, const CaptureFormat& format, std::uint64_t place)
    : file_(file), begin_(place), stream_(file, place, file.size(), 1 << 16), format_(format) {}

template <typename T>
T PacketReader::Number() {
  const T value = stream_.Number<T>();
  return format_.swapped ? Swapped(value) : value;
}

void PacketReader::ReadHead() {
  char head[sizeof(std::uint32_t)] = {};
  file_.ReadAt(0, head, sizeof(head));
  const std::string_view bytes(head, sizeof(head));
  if (!IsPacketCapture(bytes)) stream_.Fail("no capture of packets");
  const auto magic = NumberAt<std::uint32_t>(bytes, 0);
  format_.next_generation = magic == kSectionHeader;
  if (format_.next_generation) return;
  format_.swapped = magic != kMicroseconds && magic != kNanoseconds;
  const bool nanoseconds = magic == kNanoseconds || magic == Swapped(kNanoseconds);
  constexpr std::uint64_t kBeforeLink = 20;
  stream_.Skip(kBeforeLink);
  // The upper bits tell of check sums.
  format_.interfaces = {{Number<std::uint32_t>() & 0xFFFFU, nanoseconds ? 1.0 : 1000.0}};
}

// The UDP packet that a frame holds or makes whole.
bool PacketReader::TakeUdp(std::string_view frame, std::uint32_t link, UdpPacket* packet) {
  constexpr unsigned char kUdp = 17;
  constexpr std::size_t kIpBytes = 20, kUdpBytes = 8;
  const auto found = IpOf(frame, link);
  if (!found || found->size() < kIpBytes) return false;
  const std::string_view ip = *found;
  const auto byte = [&](std::size_t at) { return static_cast<unsigned char>(ip[at]); };
  const std::size_t head = 4 * static_cast<std::size_t>(byte(0) & 0xFU);
  if (byte(0) >> 4U != 4 || head < kIpBytes || byte(9) != kUdp) return false;
  const std::size_t total = std::min<std::size_t>(BigAt(ip, 2), ip.size());
  if (total < head) return false;
  std::string_view udp = ip.substr(head, total - head);
  const unsigned offset = BigAt(ip, 6) & 0x1FFFU;
  const bool more = (BigAt(ip, 6) & 0x2000U) != 0;
  std::optional<IpFragments::Datagram> whole;
  if (offset > 0 || more) {
    std::string key(ip.substr(12, 8));  // sender and receiver
    key += ip.substr(4, 2);
    whole = fragments_.Add({key, std::size_t{8} * offset, more, udp, packet->stamp_ns, place_});
    if (!whole) return false;
    udp = whole->data;
    packet->stamp_ns = whole->stamp_ns;
    place_ = whole->place;
  }
  if (udp.size() < kUdpBytes) return false;
  packet->source =
      fmt::format("{}.{}.{}.{}:{}", byte(12), byte(13), byte(14), byte(15), BigAt(udp, 2));
  const std::size_t length = std::min<std::size_t>(BigAt(udp, 4), udp.size());
  packet->payload = length < kUdpBytes ? "" : udp.substr(kUdpBytes, length - kUdpBytes);
  return true;
}

bool PacketReader::Next(UdpPacket* packet) {
  std::string data;
  std::uint32_t link = 0;
  for (;;) {
    place_ = begin_ + stream_.position();
    if (place_ >= file_.size()) return false;
    try {
      const bool frame = format_.next_generation ? NextBlock(&data, &link, &packet->stamp_ns)
                                                 : NextRecord(&data, &link, &packet->stamp_ns);
      if (frame && TakeUdp(data, link, packet)) return true;
    } catch (const InputError&) {
      cut_ = true;
      return false;
    }
  }
}

bool PacketReader::NextRecord(std::string* data, std::uint32_t* link, StampNs* stamp_ns) {
  const auto s = Number<std::uint32_t>(), fraction = Number<std::uint32_t>();
  const auto bytes = Number<std::uint32_t>();
  Number<std::uint32_t>();  // as long as it was on the wire
  *stamp_ns = static_cast<StampNs>(s) * 1'000'000'000 +
              std::llround(fraction * format_.interfaces[0].ns_per_unit);
  *link = format_.interfaces[0].link;
  *data = stream_.Text(bytes, kMostPacketBytes);
  return true;
}

bool PacketReader::NextBlock(std::string* data, std::uint32_t* link, StampNs* stamp_ns) {
  const auto type = Number<std::uint32_t>();
  auto bytes = Number<std::uint32_t>();
  constexpr std::uint32_t kHeadBytes = 12;  // type, and the length before and behind
  std::uint32_t left = 0;
  if (type == kSectionHeader) {
    // A section begins, in a byte order of its own.
    const auto order = stream_.Number<std::uint32_t>();
    const bool swapped = order != kByteOrder;
    if (swapped && order != Swapped(kByteOrder)) stream_.Fail("a section of no byte order");
    if (swapped != format_.swapped) bytes = Swapped(bytes);
    format_.swapped = swapped;
    format_.interfaces.clear();
    left = sizeof(order);
  }
  if (bytes < kHeadBytes + left || bytes % 4 != 0) stream_.Fail("a block of a wrong length");
  const std::string block = stream_.Text(bytes - kHeadBytes - left, kMostPacketBytes);
  Number<std::uint32_t>();
  if (type == kInterface) AddInterface(block);
  constexpr std::size_t kPacketHead = 20;
  if (type != kEnhancedPacket || block.size() < kPacketHead) {
    if (type == kSimplePacket) stream_.Fail("packets without stamps");
    return false;
  }
  const auto number = [&](std::size_t at) {
    return NumberAt<std::uint32_t>(block, at, format_.swapped);
  };
  if (number(0) >= format_.interfaces.size()) stream_.Fail("a packet of no interface");
  const CaptureFormat::Interface& interface = format_.interfaces[number(0)];
  const std::uint64_t units = (static_cast<std::uint64_t>(number(4)) << 32U) | number(8);
  const long double ns = static_cast<long double>(units) * interface.ns_per_unit;
  constexpr long double kMostNs = 4e18L;
  if (!(ns < kMostNs)) stream_.Fail("a stamp that does not fit 64 bits of ns");
  *stamp_ns = std::llround(ns);
  *link = interface.link;
  *data = block.substr(kPacketHead, number(12));
  return true;
}

void PacketReader::AddInterface(std::string_view block) {
  if (block.size() < 8 || format_.interfaces.size() >= kMostInterfaces) {
    stream_.Fail("an interface that is not described");
  }
  CaptureFormat::Interface interface;
  interface.link = NumberAt<std::uint16_t>(block, 0, format_.swapped);
  constexpr std::uint16_t kResolution = 9;
  for (std::size_t at = 8; at + 4 <= block.size();) {
    const auto code = NumberAt<std::uint16_t>(block, at, format_.swapped);
    const auto length = NumberAt<std::uint16_t>(block, at + 2, format_.swapped);
    if (code == 0) break;
    if (code == kResolution && length == 1 && at + 4 < block.size()) {
      const auto power = static_cast<unsigned char>(block[at + 4]);
      const double base = (power & 0x80U) != 0 ? 2.0 : 10.0;
      interface.ns_per_unit = 1e9 * std::pow(base, -static_cast<double>(power & 0x7FU));
    }
    at += 4 + (static_cast<std::size_t>(length) + 3) / 4 * 4;
  }
  format_.interfaces.push_back(interface);
}

}  // namespace lamina
