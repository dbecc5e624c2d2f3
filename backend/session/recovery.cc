#include "backend/session/recovery.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <filesystem>
#include <optional>
#include <sstream>
#include <string>
#include <utility>

#include "backend/session/checkpoint.h"
#include "core/base/error.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

using MakeMapping = std::function<std::unique_ptr<Mapping>()>;

// The first lines that differ.
std::pair<std::string, std::string> FirstDifference(const std::string& a, const std::string& b) {
  std::istringstream lines_a(a), lines_b(b);
  std::string line_a, line_b;
  while (line_a == line_b && (lines_a || lines_b)) {
    if (!std::getline(lines_a, line_a)) line_a.clear();
    if (!std::getline(lines_b, line_b)) line_b.clear();
  }
  return {line_a, line_b};
}

// Left where it is, it would count among those kept, and might be taken for one of the scans that
// are mapped in the place of its own.
void SetAside(const std::string& path, const std::string& why) {
  spdlog::error("{}; going back to the checkpoint before it", why);
  std::error_code ignored;
  fs::rename(path, path + ".damaged", ignored);
}

// With the map of another session, to localise in it.
std::unique_ptr<Mapping> MappingInBaseMap(const BaseMap& base, TileStore* tiles,
                                          const MakeMapping& make) {
  const SessionReadingLock lock(base.session);
  for (const std::int64_t scans : CheckpointsIn(base.session)) {
    try {
      std::unique_ptr<Mapping> mapping = make();
      ReadCheckpoint((fs::path(base.session) / CheckpointName(scans)).string(), base.fixed_options,
                     CheckpointPart::kMap, mapping.get());
      if (!mapping->map().HasPiece(0)) {
        throw InputError(fmt::format("{}: no scan of the first piece of the map was ever matched",
                                     CheckpointName(scans)));
      }
      tiles->CopyFrom((fs::path(base.session) / "map_tiles.db").string(), scans - 1);
      mapping->StartLocalising(base.T_world_start);
      return mapping;
    } catch (const InputError& error) {
      spdlog::error("{}; trying the checkpoint before it", error.what());
    }
  }
  throw InputError(fmt::format("{}: holds no map that could be used", base.session));
}

}  // namespace

void CheckFixedOptions(const SessionSetup& setup, SessionDatabase* database) {
  const std::optional<std::string> before = database->Meta(kFixedOptions);
  if (!before) {
    database->SetMeta(kFixedOptions, setup.fixed_options);
    return;
  }
  if (*before == setup.fixed_options) return;
  const auto [was, is] = FirstDifference(*before, setup.fixed_options);
  throw OptionError(fmt::format(
      "{}: the session was begun with other options and can only be continued with the same: it "
      "has '{}', now given '{}'",
      setup.folder, was, is));
}

RecoveredMapping RecoverMapping(const SessionSetup& setup, const SessionFolder& folder,
                                const SessionDatabase& database, TileStore* tiles,
                                const MakeMapping& make) {
  const std::int64_t recorded = database.scans();
  for (const std::int64_t scans : CheckpointsIn(folder.path())) {
    const std::string path = folder.Path(CheckpointName(scans));
    if (scans > recorded) {
      SetAside(path, fmt::format("{}: the database has lost some of its {} scans", path, scans));
      continue;
    }
    try {
      std::unique_ptr<Mapping> mapping = make();
      ReadCheckpoint(path, setup.fixed_options, CheckpointPart::kAll, mapping.get());
      tiles->RollBackTo(scans - 1);
      return {std::move(mapping), scans};
    } catch (const InputError& error) {
      SetAside(path, error.what());
    }
  }
  if (recorded > 0) spdlog::warn("no checkpoint can be used: all scans are mapped again");
  tiles->RollBackTo(-1);
  return {setup.base_map ? MappingInBaseMap(*setup.base_map, tiles, make) : make(), 0};
}

}  // namespace lamina
