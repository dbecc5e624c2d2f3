// Which scans of a recording a command worked on, and what that says about poses without stamps:
// such poses (KITTI form) are told apart by their line alone.
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/scan.h"
#include "io/recording/scan_source.h"
#include "tools/cli/common.h"

namespace lamina {

struct RecordingPart {
  std::size_t scans = 0;           // of the whole recording
  std::size_t begin = 0, end = 0;  // the part is [begin, end) of them
  // The number that is the name of scan 0, if those of all others count on from it (000000.bin) but
  // for these: raw drives lack some of their scans, and their poses do not.
  std::optional<std::size_t> first_number;
  std::vector<std::size_t> missing_numbers;

  std::size_t size() const { return end - begin; }
  // The number of scan i, if scans have numbers.
  std::size_t NumberOf(std::size_t i) const;
};

RecordingPart PartOf(const ScanSource& scans, const FrameRange& range);

// As summary.json keeps it.
nlohmann::json ToJson(const RecordingPart& part);

// What the summary.json of a run's folder keeps; nothing if it is missing or keeps none.
std::optional<RecordingPart> ReadRecordingPart(const std::string& folder);

// Poses out of a file for the scans of a part. A file without stamps has a line for each of them, for
// each of the recording, or for more than that, if scans are named by their numbers in it: it is cut
// to the lines of these scans (which is logged), and gets their stamps out of `stamps`, those of the whole recording, or
// 0, 1, 2, ... if that is empty. `first_line`, if not null, becomes the line (from 0) of the first
// of these poses. Throws InputError.
Trajectory ReadPosesOfPart(const std::string& path, const RecordingPart& part,
                           const std::vector<StampNs>& stamps, std::size_t* first_line = nullptr);

// The true poses of the scans of a part, as poses of the LiDAR (by the recording's own
// calibration). Throws InputError unless they belong together: for a truth with stamps, those of 2
// scans at least.
Trajectory ReadTruthOfPart(const std::string& path, const ScanSource& source,
                           const RecordingPart& part);

}  // namespace lamina
