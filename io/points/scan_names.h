// Stamps out of file names and stamp files of recordings.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/geometry/scan.h"

namespace lamina {

// The stamp that a name (without ending) is. `form` tells forms apart; 0: the name is no stamp.
struct NameStamp {
  StampNs stamp_ns = 0;
  std::int64_t form = 0;
};
NameStamp StampFromName(const std::string& name);

// The whole number that a name (without ending) is.
std::optional<std::int64_t> NumberFromName(const std::string& stem);

// Whether `b` counts on from `a`: the same but for the last run of digits before the ending, which
// is one higher (scan_9.pcd, scan_10.pcd).
bool IsNextName(std::string_view a, std::string_view b);

// Stamps out of the file names (without ending), or nothing unless every name is one, all in the
// same form: whole nanoseconds, microseconds or milliseconds since the Unix epoch, told apart by
// their size (years 1973 to 2286), or seconds with a decimal point; or ends with such a number, or
// with seconds and nanoseconds apart (cloud_1700000000_123456789). Plain counters are no stamps.
std::vector<StampNs> StampsFromNames(const std::vector<std::filesystem::path>& files);

// One line of a stamp file, see ReadStamps. False if it is no stamp.
bool ParseStamp(std::string_view line, StampNs* stamp_ns);

// Whether the names of the files say which of `lines` stamps are theirs, see ReadStamps.
bool NamesAreLineNumbers(const std::vector<std::filesystem::path>& files, std::size_t lines);

// How many stamps a file has. Throws InputError with file and line for a line that is none.
std::size_t CountStamps(const std::string& stamp_file);

// The stamps of `files` out of `stamp_file`, a line each: seconds (0.103694, 1.036940e-01) or date
// and time (2011-09-26 13:02:25.594360375, taken as UTC, to the ns). More lines than files are
// fine: if the names of the files are numbers that fit as line numbers (from 0), these say which
// lines are meant, as in KITTI drives with scans left out; otherwise the first lines are. Throws
// InputError with file and line.
std::vector<StampNs> ReadStamps(const std::string& stamp_file,
                                const std::vector<std::filesystem::path>& files);

}  // namespace lamina
