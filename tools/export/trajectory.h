// The trajectory of a finished run for other programs, by the ending of the file:
//
//   .csv       a line for each pose: stamp_s,x,y,z,qx,qy,qz,qw,piece
//   .geojson   a line for each piece of the map (RFC 7946), coordinates in metres in the frame of
//              the piece: a local frame, which no place on earth is known of
#pragma once

#include <string>

namespace lamina {

// Returns the number of poses. Throws InputError, OutputError; OptionError for another ending.
std::size_t ExportTrajectory(const std::string& run, const std::string& path);

}  // namespace lamina
