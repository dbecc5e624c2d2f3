// The scans of one topic in a container of messages.
//
// Private to io/recording.
#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <vector>

#include "io/container/message_container.h"
#include "io/recording/scan_source.h"

namespace lamina {

// A stamp is that in a message's header; where the first message has none there, when messages were
// recorded. It is read when it is wanted: that of one whose bytes are damaged is when it was
// recorded.
class MessageScans final : public ScanSource {
 public:
  // The topic must have messages.
  MessageScans(const std::string& path, std::shared_ptr<const MessageContainer> container,
               std::size_t topic, PointTimeUnit unit);

  std::size_t size() const override { return places_.size(); }
  std::string Name(std::size_t i) const override;
  StampNs Stamp(std::size_t i) const override;
  Scan Read(std::size_t i) const override;
  PointTimeField PointTimes(std::size_t i) const override;
  RecordingDescription Describe() const override { return described_; }

 private:
  bool HasHeaderStamps() const;

  const std::string path_;
  const PointTimeUnit unit_;
  const std::shared_ptr<const MessageContainer> container_;
  const MessageTopic topic_;
  const std::vector<MessagePlace>& places_;  // the container's
  bool header_stamps_ = false;
  // Of those that were asked for; kUnread before.
  mutable std::vector<std::atomic<StampNs>> stamps_;
  RecordingDescription described_;
};

}  // namespace lamina
