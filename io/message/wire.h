// Fields of a message out of its bytes, as ROS 1 writes them or as CDR (ROS 2).
//
//   ROS 1  little-endian, one after the other; texts and lists behind their length in 4 bytes
//   CDR    4 bytes that tell the byte order; then each number at a multiple of its size, counted
//          from there (of 4 for longer ones in version 2); texts end with a zero that is counted
//
// Private to io/message.
#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>

#include "core/geometry/scan.h"
#include "io/container/message_container.h"

namespace lamina {

class WireReader {
 public:
  // All must outlive it. Throws InputError, as all members do, beginning with `name`.
  WireReader(std::string_view bytes, MessageEncoding encoding, const std::string& name);

  template <typename T>
  T Number() {
    Align(sizeof(T));
    char bytes[sizeof(T)];
    std::memcpy(bytes, Bytes(sizeof(T)).data(), sizeof(T));
    if (big_endian_) std::reverse(bytes, bytes + sizeof(T));
    T value;
    std::memcpy(&value, bytes, sizeof(T));
    return value;
  }
  std::string_view Bytes(std::uint64_t count);
  std::string_view Text();
  // The length of a list whose items have at least so many bytes.
  std::uint32_t Count(std::uint64_t least_bytes);

  bool cdr() const { return cdr_; }
  // The bytes are numbers of this order.
  bool big_endian() const { return big_endian_; }
  std::uint64_t left() const { return bytes_.size() - at_; }
  // To the next multiple of `size`; in ROS 1 there is nothing between fields.
  void Align(std::size_t size);
  [[noreturn]] void Fail(const std::string& what) const;

 private:
  std::string_view bytes_;
  const std::string& name_;
  std::uint64_t at_ = 0;
  bool cdr_ = false, big_endian_ = false;
  std::size_t most_alignment_ = 8;
};

// std_msgs/Header, with which all sensors' messages begin.
struct MessageHeader {
  StampNs stamp_ns = 0;
  std::string frame_id;
};
// Its stamp alone, for which the first bytes of a message are enough.
StampNs ReadStamp(WireReader* wire);
MessageHeader ReadHeader(WireReader* wire);

}  // namespace lamina
