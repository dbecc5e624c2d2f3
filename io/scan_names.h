// File names and stamp files of recordings. Private to io.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "core/scan.h"

namespace lamina {

// Order of names in which runs of digits compare by their value: scan2 < scan10.
bool NaturalLess(std::string_view a, std::string_view b);

// The regular files in `folder` whose name has one of `endings` and no leading dot, in natural
// order. Throws InputError if the folder is missing or cannot be read.
std::vector<std::filesystem::path> ListFiles(const std::filesystem::path& folder,
                                             const std::vector<std::string>& endings);

// Stamps out of the file names (without ending), or nothing unless every name is one, all in the
// same form: whole nanoseconds, microseconds or milliseconds since the Unix epoch, told apart by
// their size (years 1973 to 2286), or seconds with a decimal point. Plain counters are no stamps.
std::vector<StampNs> StampsFromNames(const std::vector<std::filesystem::path>& files);

// The stamps of `files` out of `stamp_file`, a line each: seconds (0.103694, 1.036940e-01) or date
// and time (2011-09-26 13:02:25.594360375, taken as UTC, to the ns). More lines than files are
// fine: if the names of the files are numbers that fit as line numbers (from 0), these say which
// lines are meant, as in KITTI drives with scans left out; otherwise the first lines are. Throws
// InputError with file and line.
std::vector<StampNs> ReadStamps(const std::string& stamp_file,
                                const std::vector<std::filesystem::path>& files);

}  // namespace lamina
