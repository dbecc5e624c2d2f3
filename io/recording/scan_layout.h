// Where the parts of a recording are on disk: see io/recording/scan_source.h for the layouts.
#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

namespace lamina {

// Files may be missing.
struct ScanLayout {
  std::filesystem::path scans;
  std::filesystem::path stamps;
  std::filesystem::path calibration;
  bool text_scans = false;     // *.txt are scans where there is no other
  std::filesystem::path only;  // the one scan, alone of those in the folder; empty: all of them
};

// The recording that `path` means: a folder of scans, one above it, or a single scan. Throws
// InputError if the path is missing, or a file that by its name is no scan.
ScanLayout FindScanLayout(const std::filesystem::path& path);

// The recording whose scans stand in this very folder.
ScanLayout LayoutOfFolder(const std::filesystem::path& folder);

// The folders below that hold scans of their own, nearest first: none farther down than two, not
// more than five. For a message to who has named the folder above them.
struct FolderOfScans {
  std::filesystem::path folder;
  std::size_t scans = 0;
};
std::vector<FolderOfScans> FoldersBelow(const std::filesystem::path& folder);

// False only if there is surely nothing: what cannot be looked at shall fail when it is read.
bool MayExist(const std::filesystem::path& path);

}  // namespace lamina
