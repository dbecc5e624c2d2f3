// What `lamina doctor` finds in the folder of a run, and the text that it prints.
#pragma once

#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "tools/doctor/place_advice.h"
#include "tools/doctor/weak_places.h"
#include "tools/results/run_table.h"
#include "tools/results/verdict/verdict.h"

namespace lamina {

struct DoctorSource {
  std::string folder;                // of `lamina run`, or of a session
  std::string scans;                 // the recording, to name files by; may be empty
  std::optional<std::string> topic;  // of the scans in it; nothing: that of the run
  std::size_t top = 10;              // places that are told
};

struct DoctorFindings {
  std::unique_ptr<const RunTable> table;
  std::unique_ptr<const WeakPlaces> weak;
  // Out of summary.json, else judged by the table, if that has all poses.
  std::optional<RunVerdict> verdict;
  std::vector<PlaceAdvice> advice;            // of the first places, `top` at most
  std::map<StampNs, std::string> file_names;  // of the scans of the recording, by stamp
};

// Throws InputError: see ReadRunTable; also for a recording of which no scan has a stamp of the
// run.
DoctorFindings Examine(const DoctorSource& source);

// Numbers (from 1) of the places told that lie where place i of them does.
std::vector<std::size_t> PlacesBeside(const DoctorFindings& findings, std::size_t i);

// Files of the first and the last scan of a place; empty if they are not known.
std::string NameFiles(const DoctorFindings& findings, const WeakPlace& place);

// "200 scans, 12 lost, 2 skipped".
std::string DescribeRun(const RunTable& table);

// All of it, safe for a terminal; one line if nothing was found. `page` is where the page lies.
std::string DoctorText(const DoctorFindings& findings, const std::string& page);

}  // namespace lamina
