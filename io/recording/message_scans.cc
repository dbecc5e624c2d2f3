#include "io/recording/message_scans.h"

#include <fmt/format.h>

#include <limits>
#include <utility>

#include "core/base/error.h"
#include "core/base/first_readable.h"
#include "io/message/lidar_message.h"

namespace lamina {
namespace {

constexpr StampNs kUnread = std::numeric_limits<StampNs>::min();

}  // namespace

MessageScans::MessageScans(const std::string& path,
                           std::shared_ptr<const MessageContainer> container, std::size_t topic,
                           PointTimeUnit unit)
    : path_(path),
      unit_(unit),
      container_(std::move(container)),
      topic_(container_->topics()[topic]),
      places_(container_->Messages(topic)) {
  stamps_ = std::vector<std::atomic<StampNs>>(places_.size());
  for (std::atomic<StampNs>& stamp : stamps_) stamp = kUnread;
  header_stamps_ = HasHeaderStamps();
  described_.scans = fmt::format("{} messages {} on {} of {}, in the order of their recording",
                                 places_.size(), topic_.type, topic_.name, container_->kind());
  described_.stamps = header_stamps_ ? "from the messages" : "the times of recording";
  described_.doubts = container_->doubts();
}

bool MessageScans::HasHeaderStamps() const {
  const auto has_stamp = [this](std::size_t i) {
    return LidarMessageStamp(topic_, container_->Read(places_[i], kHeadBytes), Name(i)) != 0;
  };
  return FirstReadable(0, places_.size(), has_stamp).value_or(false);
}

std::string MessageScans::Name(std::size_t i) const {
  if (i >= size()) throw std::out_of_range(fmt::format("scan {} of {}", i, size()));
  return fmt::format("{}#{}", path_, i);
}

StampNs MessageScans::Stamp(std::size_t i) const {
  const StampNs known = stamps_.at(i);
  if (known != kUnread) return known;
  StampNs stamp_ns = places_[i].log_ns;
  if (header_stamps_) {
    try {
      stamp_ns = LidarMessageStamp(topic_, container_->Read(places_[i], kHeadBytes), Name(i));
    } catch (const InputError&) {
      // Reading the scan tells.
    }
  }
  stamps_[i] = stamp_ns;
  return stamp_ns;
}

Scan MessageScans::Read(std::size_t i) const {
  const std::string name = Name(i);
  Scan scan;
  container_->With(places_[i], [&](std::string_view bytes) {
    if (header_stamps_) stamps_[i] = LidarMessageStamp(topic_, bytes, name);
    scan = ScanFromMessage(topic_, bytes, unit_, name, nullptr);
  });
  GiveStamp(Stamp(i), true, &scan);
  return scan;
}

PointTimeField MessageScans::PointTimes(std::size_t i) const {
  LidarMessageInfo info;
  container_->With(places_.at(i), [&](std::string_view bytes) {
    ScanFromMessage(topic_, bytes, unit_, Name(i), &info);
  });
  return info.times;
}

}  // namespace lamina
