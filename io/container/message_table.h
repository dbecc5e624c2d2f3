// A container whose topics, places of messages and doubts are held in memory: what all of them
// have in common.
//
// Private to io/container.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "io/container/message_container.h"

namespace lamina {

// The name that a type of ROS 2 (a/msg/B) had in ROS 1 (a/B); others stay as they are.
inline std::string Ros1TypeName(std::string type) {
  const std::size_t at = type.find("/msg/");
  return at == std::string::npos ? type : type.erase(at, 4);
}

class MessageTable : public MessageContainer {
 public:
  std::string kind() const final { return kind_; }
  const std::vector<MessageTopic>& topics() const final { return topics_; }
  const std::vector<std::string>& doubts() const final { return doubts_; }
  const std::vector<MessagePlace>& Messages(std::size_t topic) const final {
    return messages_.at(topic);
  }

 protected:
  explicit MessageTable(std::string kind) : kind_(std::move(kind)) {}

  // The place of a topic of this name, type and encoding; that of a new one if there is none.
  std::size_t PlaceOf(const MessageTopic& topic) const {
    std::size_t at = 0;
    while (at < topics_.size() && !SameTopic(topics_[at], topic)) ++at;
    return at;
  }
  // Takes up topics, messages and doubts of a container whose messages are among those of this one,
  // as its part `number`. SortMessages() comes after the last.
  void AddPart(const MessageContainer& part, std::uint32_t number);
  void SortMessages();
  static bool SameTopic(const MessageTopic& a, const MessageTopic& b) {
    return a.name == b.name && a.type == b.type && a.encoding == b.encoding;
  }

  std::vector<MessageTopic> topics_;
  std::vector<std::vector<MessagePlace>> messages_;  // of each topic
  std::vector<std::string> doubts_;

 private:
  const std::string kind_;
};

}  // namespace lamina
