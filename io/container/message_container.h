// Containers of messages: ROS 1 bags, MCAP files, ROS 2 bags (folders of sqlite3 or MCAP files).
// What is inside the messages is for io/message.
//
// Memory beyond the messages that are read is bounded (64 MB), whatever the size of a file and
// whatever it says of itself. Where there is an index it is used, and only the messages wanted are
// read; a file without one, or whose end is missing, is read through once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/geometry/scan.h"

namespace lamina {

// How the fields of a message became bytes.
enum class MessageEncoding { kRos1, kCdr, kOther };

struct MessageTopic {
  std::string name;
  std::string type;  // as in ROS 1: sensor_msgs/PointCloud2, without the `msg` of ROS 2
  MessageEncoding encoding = MessageEncoding::kOther;
  std::uint64_t messages = 0;
  StampNs first_log_ns = 0, last_log_ns = 0;  // if there are any
  bool log_times_known = false;               // of topics that are not wanted they may not be
};

// Where a message is. Means something to the container that gave it, alone.
struct MessagePlace {
  StampNs log_ns = 0;  // when it was recorded
  std::uint64_t offset = 0;
  std::uint32_t chunk = 0;
  std::uint32_t part = 0;
};

// All members may be called at once.
class MessageContainer {
 public:
  virtual ~MessageContainer() = default;

  // "a ROS 1 bag", for people.
  virtual std::string kind() const = 0;
  virtual const std::vector<MessageTopic>& topics() const = 0;
  // What was damaged, missing or passed over, one line each.
  virtual const std::vector<std::string>& doubts() const = 0;
  // The messages of a topic that was wanted, in the order in which they were recorded.
  virtual const std::vector<MessagePlace>& Messages(std::size_t topic) const = 0;
  // The bytes of a message, or only the first `most`. Throws InputError naming file, place and
  // rule.
  virtual std::string Read(const MessagePlace& place, std::size_t most = SIZE_MAX) const = 0;
  // Hands them to `use`, without a copy where they lie in memory: they are there for the call
  // alone, which must not come back to the container. What it throws goes on to the caller.
  virtual void With(const MessagePlace& place,
                    const std::function<void(std::string_view bytes)>& use) const {
    use(Read(place));
  }
};

// Of which topics the messages are wanted, by their type.
using TopicFilter = std::function<bool(const MessageTopic& topic)>;

// Longer messages are refused: 20 million points have room in this.
inline constexpr std::uint64_t kMostMessageBytes = std::uint64_t{512} << 20;
// Further messages are passed over, with a line that says so: more than a day at 10 Hz.
inline constexpr std::size_t kMostMessages = 1'000'000;
inline constexpr std::size_t kMostTopics = 4096;

// Whether `path` is a file of such a container, by its ending or its first bytes, or a folder of
// them: with the metadata.yaml of a ROS 2 bag, or with such files, which are taken as parts of one
// recording.
bool IsMessageContainer(const std::string& path);

// The files that metadata.yaml of a ROS 2 bag names, taken to be beside it. Throws InputError.
std::vector<std::string> ContainerFilesInMetadata(const std::string& path);

// False if the file says of itself that its recorder has not ended: a bag without index, an MCAP
// file or a database without its end. True of what tells nothing, and of other files.
bool IsWholeContainer(const std::string& path);

// Throws InputError if it cannot be read, is none, or is damaged at its beginning.
std::unique_ptr<MessageContainer> OpenMessageContainer(const std::string& path,
                                                       const TopicFilter& wanted);

}  // namespace lamina
