// A recording in one file (bag, MCAP file, capture of packets), or in the files that the
// metadata.yaml of a ROS 2 bag names: that file then stands for all of them.
//
// A scan of it is called RECORDING#N, N counting from 0.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/recording/scan_source.h"

namespace lamina {

// Whether a file of this name is one: *.bag, *.mcap, *.pcap, *.pcapng, metadata.yaml. A *.db3 is a
// part of a ROS 2 bag, never one by itself.
bool IsRecordingFile(std::string_view name);

// All its files, those first that metadata.yaml names. Throws InputError if that cannot be read.
std::vector<std::string> FilesOfRecording(const std::string& path);

// False for a metadata.yaml that names no file: it is of something else.
bool NamesRecording(const std::string& path);

// Whether a metadata.yaml beside the file names it as a part.
bool IsPartOfRecording(const std::string& path);

// Whether a file of which it is not known whether it is still written is all there, by what it says
// of itself: the index of a bag is written last, as are the end of an MCAP file and a
// metadata.yaml.
bool IsWholeRecording(const std::string& path);

// Throws InputError as OpenScans does. Options for several sensors are an error.
std::unique_ptr<ScanSource> OpenRecordingFile(const std::string& path,
                                              const ScanSourceOptions& options);

std::string NameOfScan(const std::string& recording, std::size_t scan);
// N, if `scan` is the name of a scan of that recording; nothing for one in a folder.
std::optional<std::size_t> ScanNumber(const std::string& recording, const std::string& scan);

}  // namespace lamina
