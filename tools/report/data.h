// What a report shows, read from the folder of a run and brought into the form of the page.
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>

namespace lamina {

struct ReportSource {
  std::string folder;  // of `lamina run`, or of a session
  std::string truth;   // empty: none
  std::string calib;   // calib.txt, for a truth of the camera's poses
  double tolerance_s = 0.01;
  std::size_t max_surfels = 300000;
};

// trajectory_tum.txt and map_surfels.ply must be there; frames.csv and summary.json may be missing.
// A map (of each piece) of more than max_surfels is thinned evenly in the order of the file. Time
// series of more than 20000 values are shortened: each remaining value is the largest of its group.
// A truth without stamps is held against trajectory_kitti.txt, line by line. Throws InputError.
nlohmann::json ReadReportData(const ReportSource& source);

}  // namespace lamina
