#include "io/recording/recording_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "core/base/error.h"
#include "io/container/message_container.h"
#include "io/file/folder_list.h"
#include "io/points/scan_names.h"
#include "io/recording/capture_scans.h"
#include "io/recording/message_topics.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kMetadata = "metadata.yaml";

bool IsMetadata(const std::string& path) { return fs::path(path).filename() == kMetadata; }

std::string FolderOf(const std::string& path) { return fs::path(path).parent_path().string(); }

}  // namespace

bool IsRecordingFile(std::string_view name) {
  if (name == kMetadata) return true;
  if (name.empty() || name.front() == '.') return false;
  const std::string ending = LowerEnding(name);
  return ending == ".bag" || ending == ".mcap" || ending == ".pcap" || ending == ".pcapng";
}

std::vector<std::string> FilesOfRecording(const std::string& path) {
  if (!IsMetadata(path)) return {path};
  std::vector<std::string> files = ContainerFilesInMetadata(path);
  files.push_back(path);
  return files;
}

bool NamesRecording(const std::string& path) {
  try {
    return !IsMetadata(path) || !ContainerFilesInMetadata(path).empty();
  } catch (const InputError&) {
    return true;  // opening it tells
  }
}

bool IsPartOfRecording(const std::string& path) {
  const std::string metadata = (fs::path(FolderOf(path)) / kMetadata).string();
  std::error_code ignored;
  if (IsMetadata(path) || !fs::is_regular_file(metadata, ignored)) return false;
  try {
    const std::vector<std::string> files = ContainerFilesInMetadata(metadata);
    return std::find(files.begin(), files.end(), path) != files.end();
  } catch (const InputError&) {
    return false;
  }
}

bool IsWholeRecording(const std::string& path) {
  try {
    const std::vector<std::string> files = FilesOfRecording(path);
    return std::all_of(files.begin(), files.end(), [](const std::string& file) {
      return IsMetadata(file) || IsWholeContainer(file);
    });
  } catch (const InputError&) {
    return false;
  }
}

std::unique_ptr<ScanSource> OpenRecordingFile(const std::string& path,
                                              const ScanSourceOptions& options) {
  if (!options.T_vehicle_lidar.empty()) {
    throw InputError(
        fmt::format("{}: a recording in one file is of one sensor, and none of a vehicle's "
                    "(scans.T_vehicle_lidar)",
                    path));
  }
  if (HoldsPackets(path)) return std::make_unique<CaptureScans>(path, options);
  return OpenMessages(IsMetadata(path) ? FolderOf(path) : path, options);
}

std::string NameOfScan(const std::string& recording, std::size_t scan) {
  return fmt::format("{}#{}", recording, scan);
}

std::optional<std::size_t> ScanNumber(const std::string& recording, const std::string& scan) {
  if (recording.empty() || scan.size() <= recording.size() + 1) return std::nullopt;
  if (scan.compare(0, recording.size(), recording) != 0 || scan[recording.size()] != '#') {
    return std::nullopt;
  }
  const std::optional<std::int64_t> number = NumberFromName(scan.substr(recording.size() + 1));
  if (!number) return std::nullopt;
  return static_cast<std::size_t>(*number);
}

}  // namespace lamina
