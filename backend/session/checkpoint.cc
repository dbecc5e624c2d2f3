#include "backend/session/checkpoint.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "io/store/checkpoint_file.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// Throws InputError naming the file.
template <typename Read>
void ReadState(const std::string& path, std::string_view bytes, const Read& read) {
  try {
    StateArchive archive(bytes);
    read(archive);
    if (archive.unread() > 0) throw InputError("saved state is longer than it should be");
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: {}", path, error.what()));
  }
}

}  // namespace

std::string CheckpointName(std::int64_t scans) { return fmt::format("checkpoint-{}.lmap", scans); }

std::vector<std::int64_t> CheckpointsIn(const std::string& folder) {
  std::vector<std::int64_t> found;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    long long scans = 0;
    if (std::sscanf(name.c_str(), "checkpoint-%lld.lmap", &scans) == 1 &&
        name == CheckpointName(scans)) {
      found.push_back(scans);
    }
  }
  std::sort(found.begin(), found.end(), std::greater<>());
  return found;
}

std::uint64_t ReadCheckpoint(const std::string& path, const std::string& fixed_options,
                             CheckpointPart part, Mapping* mapping) {
  CheckpointReader reader(path);
  VoxelMap& map = mapping->map();
  std::string tag, bytes, options, pipe;
  std::int64_t scans = -1;
  std::uint64_t tiles = 0;
  while (reader.Next(&tag, &bytes)) {
    if (tag == "PIPE") {
      pipe.swap(bytes);  // it needs the map
    } else if (tag == "HEAD") {
      ReadState(path, bytes, [&](StateArchive& a) { a(&scans, &options, &tiles); });
    } else if (tag == "MAPC") {
      ReadState(path, bytes, [&](StateArchive& a) { map.ArchiveCounters(a); });
    } else if (tag == "ROOT") {
      ReadState(path, "", [&](StateArchive&) { map.Load(bytes); });
    }
    if (options != fixed_options) {
      throw InputError(fmt::format("{}: was made with other options", path));
    }
  }
  if (fs::path(path).filename() != CheckpointName(scans)) {
    throw InputError(fmt::format("{}: is in truth of {} scans", path, scans));
  }
  map.FinishLoading();
  if (part == CheckpointPart::kAll)
    ReadState(path, pipe, [&](StateArchive& a) { mapping->Archive(a); });
  return tiles;
}

}  // namespace lamina
