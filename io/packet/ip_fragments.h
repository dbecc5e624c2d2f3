// Datagrams out of the fragments that IPv4 sends them in (RFC 791): those of Ouster's sensors are
// longer than a frame of Ethernet.
#pragma once

#include <cstddef>
#include <cstdint>
#include <list>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "core/geometry/scan.h"

namespace lamina {

// Memory is bounded (4 MB): of many unfinished datagrams the oldest is dropped. Not thread-safe.
class IpFragments {
 public:
  struct Fragment {
    std::string_view key;  // sender, receiver and number of the datagram
    std::size_t offset = 0;
    bool more = false;  // follow behind it
    std::string_view data;
    StampNs stamp_ns = 0;     // when it was captured
    std::uint64_t place = 0;  // in the file
  };
  // Its stamp and place are those of the fragment that came first.
  struct Datagram {
    std::string data;
    StampNs stamp_ns = 0;
    std::uint64_t place = 0;
  };
  // The datagram of a fragment, if that makes it whole. One that overlaps others begins a datagram
  // of its own, since numbers come again; one that goes beyond what a datagram can hold drops its
  // own.
  std::optional<Datagram> Add(const Fragment& fragment);

 private:
  struct Unfinished {
    std::string key;
    std::map<std::size_t, std::string> parts;  // by offset
    std::optional<std::size_t> bytes;          // known from the last one
    std::size_t received = 0;
    StampNs stamp_ns = 0;
    std::uint64_t place = 0;
  };
  std::list<Unfinished>::iterator Begin(const Fragment& fragment);

  std::list<Unfinished> unfinished_;  // the oldest first
};

}  // namespace lamina
