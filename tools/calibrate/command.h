// `lamina calibrate`: the offsets of a sensor's elevation and range that make its map thinnest, of
// all beams alike, or with --beams of each.
#pragma once

#include <functional>
#include <string>

#include "backend/calibration/recording_beams.h"
#include "backend/calibration/recording_calibration.h"

namespace CLI {
class App;
}

namespace lamina {

// What was found, with standard deviations, the thickness of the map before and after, and the
// lines that put it into a configuration file.
std::string DescribeCalibration(const RecordingCalibration& calibration,
                                const CalibrationOptions& options);

// How far points lie off their planes without the offsets of each beam and with them, and the lines
// that put these into a configuration file.
std::string DescribeBeams(const RecordingBeams& found);

// Adds the command to the program's parser; when it is chosen, *run becomes what executes it.
void AddCalibrateCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
