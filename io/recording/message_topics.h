// Which topics of a container of messages hold scans, and the scans of one of them.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "io/container/message_container.h"
#include "io/recording/scan_source.h"

namespace lamina {

// Of the topics whose messages are needed to tell: those of scans, of packets, of what describes a
// sensor.
bool IsWantedTopic(const MessageTopic& topic);

// Those that have scans, or packets of points, in a container that was opened with IsWantedTopic.
std::vector<std::size_t> TopicsOfScans(const MessageContainer& container);

// Throws InputError if the container cannot be read or holds no scans, and, naming all topics that
// do, if it is not clear which one is meant.
std::unique_ptr<ScanSource> OpenMessages(const std::string& path, const ScanSourceOptions& options);

}  // namespace lamina
