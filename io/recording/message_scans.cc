#include "io/recording/message_scans.h"

#include <fmt/format.h>

#include <limits>

#include "core/base/error.h"
#include "io/message/lidar_message.h"

namespace lamina {
namespace {

constexpr StampNs kUnread = std::numeric_limits<StampNs>::min();

std::string NameTopics(const MessageContainer& container, const TopicFilter& named) {
  constexpr std::size_t kMost = 12;
  std::string text;
  std::size_t count = 0;
  for (const MessageTopic& topic : container.topics()) {
    if (!named(topic) || ++count > kMost) continue;
    text += fmt::format("{}{} ({}, {} messages)", text.empty() ? "" : ", ", topic.name, topic.type,
                        topic.messages);
  }
  if (count > kMost) text += fmt::format(" and {} more", count - kMost);
  return text;
}

std::size_t ChooseTopic(const MessageContainer& container, const std::string& path,
                        const std::string& wanted) {
  const std::vector<MessageTopic>& topics = container.topics();
  std::vector<std::size_t> lidar;
  for (std::size_t t = 0; t < topics.size(); ++t) {
    if (IsLidarTopic(topics[t]) && topics[t].name == wanted) return t;
    if (IsLidarTopic(topics[t]) && !container.Messages(t).empty()) lidar.push_back(t);
  }
  const auto any = [](const MessageTopic&) { return true; };
  const std::string all = NameTopics(container, any);
  if (!wanted.empty()) {
    throw InputError(
        fmt::format("{}: '{}' is no topic of scans in it (--topic, scans.topic); it holds {}", path,
                    wanted, all.empty() ? "no topic" : all));
  }
  if (lidar.size() == 1) return lidar.front();
  if (lidar.empty()) {
    throw InputError(fmt::format("{}: holds no scans ({}); it holds {}", path, LidarTypes(),
                                 all.empty() ? "no message" : all));
  }
  throw InputError(
      fmt::format("{}: holds {} topics of scans: {}; choose one by --topic NAME "
                  "(scans.topic)",
                  path, lidar.size(), NameTopics(container, IsLidarTopic)));
}

}  // namespace

MessageScans::MessageScans(const std::string& path, const ScanSourceOptions& options)
    : path_(path),
      unit_(options.point_time_unit),
      container_(OpenMessageContainer(path, IsLidarTopic)) {
  const std::size_t topic = ChooseTopic(*container_, path, options.topic);
  topic_ = container_->topics()[topic];
  places_ = container_->Messages(topic);
  if (places_.empty()) {
    throw InputError(fmt::format("{}: topic {} has no message", path, topic_.name));
  }
  stamps_ = std::vector<std::atomic<StampNs>>(places_.size());
  for (std::atomic<StampNs>& stamp : stamps_) stamp = kUnread;
  header_stamps_ = HasHeaderStamps();
  described_.scans = fmt::format("{} messages {} on {} of {}, in the order of their recording",
                                 places_.size(), topic_.type, topic_.name, container_->kind());
  described_.stamps = header_stamps_ ? "from the messages" : "the times of recording";
  described_.doubts = container_->doubts();
}

bool MessageScans::HasHeaderStamps() const {
  constexpr std::size_t kTries = 5;
  for (std::size_t i = 0; i < std::min(kTries, places_.size()); ++i) {
    try {
      return LidarMessageStamp(topic_, container_->Read(places_[i], kHeadBytes), Name(i)) != 0;
    } catch (const InputError&) {
      // The next one may be readable.
    }
  }
  return false;
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
  const std::string name = Name(i), bytes = container_->Read(places_[i]);
  if (header_stamps_) stamps_[i] = LidarMessageStamp(topic_, bytes, name);
  Scan scan = ScanFromMessage(topic_, bytes, unit_, name, nullptr);
  GiveStamp(Stamp(i), true, &scan);
  return scan;
}

PointTimeField MessageScans::PointTimes(std::size_t i) const {
  LidarMessageInfo info;
  ScanFromMessage(topic_, container_->Read(places_.at(i)), unit_, Name(i), &info);
  return info.times;
}

}  // namespace lamina
