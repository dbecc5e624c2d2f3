// Options of a session, and what it is begun with.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "backend/mapping/options.h"
#include "core/geometry/se3.h"
#include "core/options/options.h"
#include "io/store/scan_record.h"

namespace lamina {

struct SessionOptions {
  // A checkpoint is begun every so many scans, earlier where much of the map has come back from
  // disk. After an interruption as many are mapped again.
  int checkpoint_every_scans = 300;
  // The trajectory files are at most so old.
  double trajectory_period_s = 5.0;

  void Visit(OptionVisitor& v);
};

// A finished map to localise in, instead of making one.
struct BaseMap {
  std::string session;        // its folder
  std::string fixed_options;  // those that it must have been begun with
  // Where the first scan is, roughly, in piece 0 of its map; without it, the map is to show that.
  std::optional<SE3> T_world_start;
};

struct SessionSetup {
  std::string folder;  // made if it is not there
  MappingOptions mapping;
  // What decides results, as text: a session can only be continued with the same.
  std::string fixed_options;
  SessionOptions session;
  std::optional<BaseMap> base_map;
  // Whether the file of a scan that was recorded is still there. If not set, it is.
  std::function<bool(const ScanRecord&)> has_file;
};

}  // namespace lamina
