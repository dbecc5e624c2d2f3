// The recordings of a campaign, as YAML:
//
//     recordings:
//       - /data/day1.mcap              # a recording, as for `lamina run --scans`
//       - /data/day2/*.bag             # a pattern: each of these files or folders, by name
//       - scans: night/drive3          # relative paths begin at the list's own folder
//         name: drive3                 # of its folder in the results; else the last part of scans
//         frames: 0:5000               # as --frames
//         topic: /os_cloud             # as --topic
#pragma once

#include <string>
#include <vector>

namespace lamina {

struct ListedRecording {
  std::string name;  // differs from all others
  std::string scans;
  std::string frames, topic;  // empty: all, the only one
};

// In the order of the list. Throws InputError if the file cannot be read, OptionError for what is
// wrong in it, with file and line: unknown keys, no recordings, patterns without a match, names
// that two recordings have or that are no names of folders.
std::vector<ListedRecording> ReadRecordingList(const std::string& path);

}  // namespace lamina
