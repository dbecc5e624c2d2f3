// UDP packets in a capture file: pcap (either byte order, us or ns) and pcapng. IPv4 over Ethernet
// (with VLAN tags), Linux cooked captures or raw IP; fragments are put together.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/geometry/scan.h"
#include "io/packet/ip_fragments.h"
#include "io/stream/byte_stream.h"

namespace lamina {

struct UdpPacket {
  StampNs stamp_ns = 0;  // when it was captured
  std::string source;    // "192.168.1.201:2368": the sender, and the port that it sends to
  std::string payload;
};

// Whether a file begins like a capture.
bool IsPacketCapture(std::string_view head);

// What stands before the packets and tells how to read them.
struct CaptureFormat {
  bool next_generation = false;  // pcapng
  bool swapped = false;          // numbers are of the other byte order
  struct Interface {
    std::uint32_t link = 0;
    double ns_per_unit = 1000.0;
  };
  std::vector<Interface> interfaces;  // one in a pcap
};

// Reads packets one after the other, from the beginning or from the place of one of them. Not
// thread-safe; several may read one file. Throws InputError if it is damaged.
class PacketReader {
 public:
  // The file must outlive it.
  explicit PacketReader(const RandomFile& file);
  PacketReader(const RandomFile& file, const CaptureFormat& format, std::uint64_t place);

  // The next UDP packet; false at the end. A file that ends inside a packet ends before it, and
  // `cut` is true then.
  bool Next(UdpPacket* packet);
  bool cut() const { return cut_; }
  // Of the packet that was read last: where the first of its bytes are.
  std::uint64_t place() const { return place_; }
  const CaptureFormat& format() const { return format_; }

 private:
  template <typename T>
  T Number();
  void ReadHead();
  bool NextRecord(std::string* data, std::uint32_t* link, StampNs* stamp_ns);
  bool NextBlock(std::string* data, std::uint32_t* link, StampNs* stamp_ns);
  void AddInterface(std::string_view block);
  bool TakeUdp(std::string_view frame, std::uint32_t link, UdpPacket* packet);

  const RandomFile& file_;
  const std::uint64_t begin_;
  FileStream stream_;
  CaptureFormat format_;
  IpFragments fragments_;
  std::uint64_t place_ = 0;
  bool cut_ = false;
};

}  // namespace lamina
