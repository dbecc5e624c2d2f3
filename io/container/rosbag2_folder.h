// Which files in a folder are a recording.
//
// Private to io/container.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace lamina {

// *.bag, *.mcap, *.db3, and those two of ROS 2 with .zstd or .zst behind.
bool IsContainerName(std::string_view name);

// The files that metadata.yaml of a ROS 2 bag names, taken to be in this very folder; where there
// is none, those of such names, in natural order. Throws InputError if the folder cannot be read.
std::vector<std::string> ContainerFilesIn(const std::string& folder);

}  // namespace lamina
