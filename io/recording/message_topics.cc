#include "io/recording/message_topics.h"

#include <fmt/format.h>

#include <numeric>
#include <utility>

#include "core/base/error.h"
#include "io/message/lidar_message.h"
#include "io/message/packet_message.h"
#include "io/recording/message_scans.h"
#include "io/recording/packet_scans.h"

namespace lamina {
namespace {

std::string NameTopics(const MessageContainer& container, const std::vector<std::size_t>& named) {
  constexpr std::size_t kMost = 12;
  std::string text;
  std::size_t count = 0;
  for (const std::size_t t : named) {
    const MessageTopic& topic = container.topics()[t];
    if (++count > kMost) continue;
    text += fmt::format("{}{} ({}, {} messages)", text.empty() ? "" : ", ", topic.name, topic.type,
                        topic.messages);
  }
  if (count > kMost) text += fmt::format(" and {} more", count - kMost);
  return text;
}

std::size_t ChooseTopic(const MessageContainer& container, const std::string& path,
                        const std::string& wanted) {
  const std::vector<std::size_t> lidar = TopicsOfScans(container);
  const std::vector<MessageTopic>& topics = container.topics();
  for (const std::size_t t : lidar) {
    if (topics[t].name == wanted) return t;
  }
  std::vector<std::size_t> any(topics.size());
  std::iota(any.begin(), any.end(), std::size_t{0});
  const std::string all = NameTopics(container, any);
  if (!wanted.empty()) {
    throw InputError(
        fmt::format("{}: '{}' is no topic of scans in it (--topic, scans.topic); it holds {}", path,
                    wanted, all.empty() ? "no topic" : all));
  }
  if (lidar.size() == 1) return lidar.front();
  if (lidar.empty()) {
    throw InputError(fmt::format("{}: holds no scans ({}, {}); it holds {}", path, LidarTypes(),
                                 PacketTypes(), all.empty() ? "no message" : all));
  }
  throw InputError(
      fmt::format("{}: holds {} topics of scans: {}; choose one by --topic NAME "
                  "(scans.topic)",
                  path, lidar.size(), NameTopics(container, lidar)));
}

}  // namespace

bool IsWantedTopic(const MessageTopic& topic) {
  return IsLidarTopic(topic) || IsPacketTopic(topic) || IsSensorMetadataTopic(topic);
}

std::vector<std::size_t> TopicsOfScans(const MessageContainer& container) {
  std::vector<std::size_t> found;
  for (std::size_t t = 0; t < container.topics().size(); ++t) {
    const bool scans = IsLidarTopic(container.topics()[t]) && !container.Messages(t).empty();
    if (scans || HoldsPointPackets(container, t)) found.push_back(t);
  }
  return found;
}

std::unique_ptr<ScanSource> OpenMessages(const std::string& path,
                                         const ScanSourceOptions& options) {
  std::shared_ptr<const MessageContainer> container = OpenMessageContainer(path, IsWantedTopic);
  const std::size_t topic = ChooseTopic(*container, path, options.topic);
  if (IsPacketTopic(container->topics()[topic])) {
    return std::make_unique<PacketScans>(path, std::move(container), topic);
  }
  return std::make_unique<MessageScans>(path, std::move(container), topic, options.point_time_unit);
}

}  // namespace lamina
