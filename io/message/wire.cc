#include "io/message/wire.h"

#include <fmt/format.h>

#include "core/base/error.h"

namespace lamina {

WireReader::WireReader(std::string_view bytes, MessageEncoding encoding, const std::string& name)
    : bytes_(bytes), name_(name), cdr_(encoding == MessageEncoding::kCdr) {
  if (encoding == MessageEncoding::kOther) Fail("is written neither as in ROS 1 nor as CDR");
  if (!cdr_) return;
  constexpr std::uint64_t kCdrHeadBytes = 4;
  if (bytes_.size() < kCdrHeadBytes) Fail("is shorter than the head of CDR");
  const auto kind = static_cast<unsigned char>(bytes_[1]);
  const bool version_1 = kind <= 1, version_2 = kind == 6 || kind == 7;
  if (bytes_[0] != 0 || (!version_1 && !version_2)) {
    Fail(fmt::format("is written in a form of CDR that is not read ({:#04x})", kind));
  }
  big_endian_ = kind % 2 == 0;
  if (version_2) most_alignment_ = 4;
  bytes_.remove_prefix(kCdrHeadBytes);
}

void WireReader::Align(std::size_t size) {
  if (!cdr_) return;
  const std::uint64_t step = std::min(size, most_alignment_);
  at_ = (at_ + step - 1) / step * step;
}

std::string_view WireReader::Bytes(std::uint64_t count) {
  if (at_ > bytes_.size() || count > bytes_.size() - at_) {
    Fail(fmt::format("ends at byte {}, inside a field", bytes_.size()));
  }
  at_ += count;
  return bytes_.substr(static_cast<std::size_t>(at_ - count), static_cast<std::size_t>(count));
}

std::string_view WireReader::Text() {
  std::string_view text = Bytes(Number<std::uint32_t>());
  if (cdr_ && !text.empty() && text.back() == '\0') text.remove_suffix(1);
  return text;
}

std::uint32_t WireReader::Count(std::uint64_t least_bytes) {
  const auto count = Number<std::uint32_t>();
  if (count > left() / least_bytes) {
    Fail(fmt::format("has a list of {} items, and {} bytes for it", count, left()));
  }
  return count;
}

void WireReader::Fail(const std::string& what) const {
  throw InputError(fmt::format("{}: {}", name_, what));
}

StampNs ReadStamp(WireReader* wire) {
  if (!wire->cdr()) wire->Number<std::uint32_t>();  // a counter
  const auto s = wire->Number<std::uint32_t>();
  const auto ns = wire->Number<std::uint32_t>();
  return static_cast<StampNs>(s) * 1'000'000'000 + static_cast<StampNs>(ns);
}

MessageHeader ReadHeader(WireReader* wire) {
  MessageHeader header;
  header.stamp_ns = ReadStamp(wire);
  header.frame_id = std::string(wire->Text());
  return header;
}

}  // namespace lamina
