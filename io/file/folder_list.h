// The files of a folder, in the order in which people count them.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace lamina {

// The ending of a file's name, with its dot, in lower case: `.las` of SCAN.LAS. Empty if there is
// none.
std::string LowerEnding(std::string_view name);

// Order of names in which runs of digits compare by their value: scan2 < scan10.
bool NaturalLess(std::string_view a, std::string_view b);

// The regular files in `folder` whose names are wanted, in natural order. Throws InputError if the
// folder is missing or cannot be read.
using FileFilter = std::function<bool(const std::string& name)>;
std::vector<std::filesystem::path> ListFiles(const std::filesystem::path& folder,
                                             const FileFilter& wanted);

}  // namespace lamina
