#include "backend/session/recovery.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <map>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "backend/localisation/map_places.h"
#include "backend/localisation/place_index.h"
#include "backend/loops/piece_loops.h"
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

// As after the file was lost, or cut.
void ReportMissing(const std::string& path, const TileStore& tiles, std::uint64_t records) {
  if (tiles.records() == records) return;
  spdlog::error("{}: has {} of {} records of the map: what the others held is missing from it",
                path, tiles.records(), records);
}

// By piece, in its frame.
using Ways = std::map<std::int64_t, std::vector<Eigen::Vector3d>>;

// With the map of another session as it stands in a checkpoint, corrected by its loops, and, where
// no start is known, the ways through it.
std::unique_ptr<Mapping> CopyOfMap(const SessionSetup& setup, std::int64_t scans, TileStore* tiles,
                                   const MakeMapping& make, Ways* ways) {
  const BaseMap& base = *setup.base_map;
  const std::string path = (fs::path(base.session) / CheckpointName(scans)).string();
  std::unique_ptr<Mapping> mapping = make();
  if (setup.mapping.loops.enabled) {
    // What it matches to is the part around its sensor alone.
    ByteFile submaps((fs::path(base.session) / kSubmapLeavesName).string(),
                     ByteFile::Lifetime::kReadOnly);
    Mapping mapped(setup.mapping, {}, nullptr, &submaps);
    ReadCheckpoint(path, base.fixed_options, CheckpointPart::kAll, &mapped);
    if (mapped.loops() != nullptr) {
      mapped.Finish();
      mapped.loops()->AddCorrectedTo(&mapping->map());
      for (const auto& [piece, closure] : mapped.loops()->pieces()) {
        for (std::size_t i = 0; i < closure->submaps().size(); ++i) {
          for (const SubmapKeyframe& keyframe : closure->submaps()[i].keyframes)
            (*ways)[piece].push_back(closure->anchors()[i] * keyframe.T_submap_lidar.t);
        }
      }
      return mapping;
    }
  }
  const std::uint64_t records =
      ReadCheckpoint(path, base.fixed_options, CheckpointPart::kMap, mapping.get());
  if (!mapping->map().HasPiece(0)) {
    throw InputError(fmt::format("{}: no scan of the first piece of the map was ever matched",
                                 CheckpointName(scans)));
  }
  const std::string other_tiles = (fs::path(base.session) / "map_tiles.db").string();
  tiles->CopyFrom(other_tiles, scans - 1);
  ReportMissing(other_tiles, *tiles, records);
  if (base.T_world_start) return mapping;
  ForEachScanOf((fs::path(base.session) / "session.db").string(), scans,
                [&](const ScanRecord& scan) {
                  if (scan.keyframe && !scan.skipped && mapping->map().HasPiece(scan.piece))
                    (*ways)[scan.piece].push_back(scan.T_world_lidar.t);
                });
  return mapping;
}

// To localise in the map of another session.
std::unique_ptr<Mapping> MappingInBaseMap(const SessionSetup& setup, TileStore* tiles,
                                          const MakeMapping& make) {
  const BaseMap& base = *setup.base_map;
  const SessionReadingLock lock(base.session);
  for (const std::int64_t scans : CheckpointsIn(base.session)) {
    try {
      Ways ways;
      std::unique_ptr<Mapping> mapping = CopyOfMap(setup, scans, tiles, make, &ways);
      if (base.T_world_start) {
        mapping->StartLocalising(*base.T_world_start);
        return mapping;
      }
      std::vector<MapPlace> places;
      for (const auto& [piece, way] : ways)
        AddPlaces(piece, way, PlaceIndex::SpacingM(setup.mapping.loops), &places);
      mapping->StartLocalising(places);
      spdlog::info("the map is searched for the scans: {} places of {} pieces", places.size(),
                   ways.size());
      return mapping;
    } catch (const OtherFormatError&) {
      throw;
    } catch (const InputError& error) {
      spdlog::error("{}; trying the checkpoint before it", error.what());
    }
  }
  throw InputError(fmt::format("{}: holds no map that could be used", base.session));
}

// Those of the first scans: files go in the order of scans.
bool FilesAreGone(const SessionSetup& setup, const SessionDatabase& database) {
  constexpr std::int64_t kFirst = 10;
  bool gone = false;
  if (!setup.has_file) return false;
  database.ForEach(0, std::min(kFirst, database.scans()), [&](const ScanRecord& scan) {
    gone = gone || (!scan.skipped && !setup.has_file(scan));
  });
  return gone;
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
                                const SessionDatabase& database, const SessionStores& stores,
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
      const std::uint64_t records =
          ReadCheckpoint(path, setup.fixed_options, CheckpointPart::kAll, mapping.get());
      stores.tiles->RollBackTo(scans - 1);
      ReportMissing(folder.Path("map_tiles.db"), *stores.tiles, records);
      return {std::move(mapping), scans};
    } catch (const OtherFormatError& error) {
      throw OtherFormatError(fmt::format(
          "{}: the session goes on with the version of Lamina that began it", error.what()));
    } catch (const InputError& error) {
      SetAside(path, error.what());
    }
  }
  if (FilesAreGone(setup, database)) {
    throw InputError(fmt::format(
        "{}: no checkpoint can be used, and the files of the first scans are gone: the session "
        "cannot be continued. What is in it stays; begin another one",
        folder.path()));
  }
  if (recorded > 0) spdlog::warn("no checkpoint can be used: all scans are mapped again");
  stores.tiles->RollBackTo(-1);
  if (stores.submaps != nullptr) stores.submaps->RollBackTo(0);
  return {setup.base_map ? MappingInBaseMap(setup, stores.tiles, make) : make(), 0};
}

}  // namespace lamina
