// What guards the folder that results go to: the scans of a recording, sessions, and results that
// are there already.
#pragma once

#include <string>
#include <vector>

namespace lamina {

// Whether `path` is `folder` or lies in it, whatever links lead there. Neither needs to exist.
bool IsWithin(const std::string& path, const std::string& folder);

// A session of `lamina watch`.
bool IsSession(const std::string& folder);

// Results of `lamina run` or `register`.
bool HoldsResults(const std::string& folder);

// Refuses `out` (OptionError) where results must not go: where the scans are, or in a session. Logs
// that results there will be replaced.
void CheckOutputFolder(const std::string& out, const std::string& scans);

// Refuses `path` (OptionError naming `option`) where it is a file of a run, a registration or a
// session that other commands read: it would be lost.
void CheckReplacesNoResult(const std::string& option, const std::string& path);

// To be called just before new results replace those of the folder: removes the old ones that will
// not be replaced (of another command, or made from them: pictures, clouds, maps of pieces), and
// logs what they were. summary.json, which is written last, is removed in any case: where it is,
// all is of one run. `written`: names of the files that are about to be written. Does nothing in a
// folder without results: what else is there is not ours.
void RemoveStaleResults(const std::string& out, const std::vector<std::string>& written);

}  // namespace lamina
