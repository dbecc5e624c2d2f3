#include "io/container/message_table.h"

#include <algorithm>

namespace lamina {

void MessageTable::AddPart(const MessageContainer& part, std::uint32_t number) {
  doubts_.insert(doubts_.end(), part.doubts().begin(), part.doubts().end());
  for (std::size_t t = 0; t < part.topics().size(); ++t) {
    const MessageTopic& topic = part.topics()[t];
    const std::size_t at = PlaceOf(topic);
    if (at == topics_.size()) {
      topics_.push_back(topic);
      messages_.emplace_back();
    } else if (MessageTopic& all = topics_[at]; topic.messages > 0) {
      const bool first = all.messages == 0;
      all.first_log_ns =
          first ? topic.first_log_ns : std::min(all.first_log_ns, topic.first_log_ns);
      all.last_log_ns = first ? topic.last_log_ns : std::max(all.last_log_ns, topic.last_log_ns);
      all.log_times_known = topic.log_times_known && (first || all.log_times_known);
      all.messages += topic.messages;
    }
    for (MessagePlace place : part.Messages(t)) {
      place.part = number;
      messages_[at].push_back(place);
    }
  }
}

void MessageTable::SortMessages() {
  for (std::vector<MessagePlace>& places : messages_) {
    std::stable_sort(
        places.begin(), places.end(),
        [](const MessagePlace& a, const MessagePlace& b) { return a.log_ns < b.log_ns; });
  }
}

}  // namespace lamina
