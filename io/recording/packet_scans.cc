#include "io/recording/packet_scans.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "core/base/error.h"
#include "core/base/first_readable.h"
#include "io/packet/sensor_files.h"

namespace lamina {
namespace {

// Of a topic: what stands before its last name.
std::string_view SpaceOf(std::string_view topic) { return topic.substr(0, topic.rfind('/') + 1); }

// Drivers have written a byte more than the packet has.
constexpr std::size_t kMostBehind = 1;

// Length of the packet in a message; nothing if it cannot be read.
std::optional<std::size_t> PacketBytes(const MessageContainer& container, const MessageTopic& topic,
                                       const MessagePlace& place) {
  try {
    const std::string head = container.Read(place, kPacketHeadBytes);
    return PacketInMessage(topic, head, "").bytes;
  } catch (const InputError&) {
    return std::nullopt;
  }
}

}  // namespace

bool HoldsPointPackets(const MessageContainer& container, std::size_t topic) {
  if (!IsPacketTopic(container.topics()[topic])) return false;
  constexpr std::size_t kFewestBytes = 256;  // those of the IMU have 48
  const std::vector<MessagePlace>& places = container.Messages(topic);
  for (std::size_t i = 0; i < std::min(kReadTries, places.size()); ++i) {
    const auto bytes = PacketBytes(container, container.topics()[topic], places[i]);
    if (bytes) return *bytes >= kFewestBytes;
  }
  return false;
}

PacketScans::PacketScans(const std::string& path, std::shared_ptr<const MessageContainer> container,
                         std::size_t topic)
    : SweepScans(path),
      container_(std::move(container)),
      topic_(container_->topics()[topic]),
      sensor_(FindSensor(topic)),
      messages_(container_->Messages(topic)) {
  const std::uint64_t packets = FindSweeps();
  described_.scans = fmt::format("{} sweeps of {} packets{} on {} of {}", sweeps_.size(), packets,
                                 OfSensor(), topic_.name, container_->kind());
  described_.stamps = "the times of recording";
  described_.doubts = container_->doubts();
  if (packets < messages_.size()) {
    described_.doubts.push_back(
        fmt::format("{} messages on {} hold no packet of the sensor that "
                    "its metadata describes: passed over",
                    messages_.size() - packets, topic_.name));
  }
}

std::unique_ptr<OusterSensor> PacketScans::FindSensor(std::size_t topic) const {
  // That of the same name space, else of any.
  std::optional<std::size_t> best;
  for (std::size_t t = 0; t < container_->topics().size(); ++t) {
    const MessageTopic& other = container_->topics()[t];
    if (!IsSensorMetadataTopic(other) || container_->Messages(t).empty()) continue;
    if (!best || SpaceOf(other.name) == SpaceOf(container_->topics()[topic].name)) best = t;
  }
  if (best) {
    const MessageTopic& told = container_->topics()[*best];
    const std::string name = fmt::format("{}: {}", path(), told.name);
    const std::string bytes = container_->Read(container_->Messages(*best).front());
    return std::make_unique<OusterSensor>(
        ParseOusterMetadata(TextInMessage(told, bytes, name), name));
  }
  const std::string json = FindOusterMetadata(path());
  if (json.empty()) {
    throw InputError(
        fmt::format("{}: packets on {} need the sensor's metadata: a topic called metadata, or a "
                    "metadata.json beside the recording",
                    path(), topic_.name));
  }
  return std::make_unique<OusterSensor>(ParseOusterMetadata(ReadSmallFile(json), json));
}

std::string_view PacketScans::PacketOf(std::string_view message) const {
  try {
    const MessagePacket packet = PacketInMessage(topic_, message, "");
    const bool fits = packet.bytes >= sensor_->packet_bytes() &&
                      packet.bytes <= sensor_->packet_bytes() + kMostBehind;
    return fits ? packet.data.substr(0, sensor_->packet_bytes()) : std::string_view();
  } catch (const InputError&) {
    return {};
  }
}

std::uint64_t PacketScans::FindSweeps() {
  SweepFinder finder;
  for (std::size_t i = 0; i < messages_.size(); ++i) {
    std::string head;
    try {
      head = container_->Read(messages_[i], kPacketHeadBytes);
    } catch (const InputError&) {
      continue;  // counted by the caller
    }
    const std::string_view packet = PacketOf(head);
    if (packet.size() < OusterSensor::kHeadBytes) continue;
    finder.Add(*sensor_, sensor_->PlaceInHead(packet), i, messages_[i].log_ns);
  }
  sweeps_ = std::move(finder.sweeps());
  if (sweeps_.empty()) {
    throw InputError(
        fmt::format("{}: topic {} holds no packets of the sensor that its metadata "
                    "describes",
                    path(), topic_.name));
  }
  return finder.packets();
}

void PacketScans::ForEachPacket(const Sweep& sweep, const UsePacket& use) const {
  for (std::size_t i = sweep.place; i <= sweep.last; ++i) {
    container_->With(messages_[i], [&](std::string_view message) {
      const std::string_view packet = PacketOf(message);
      if (!packet.empty()) use(packet, messages_[i].log_ns);
    });
  }
}

}  // namespace lamina
