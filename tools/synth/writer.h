// Synthetic recordings on disk, in the layout of KITTI odometry.
#pragma once

#include <cstddef>
#include <functional>
#include <string>

#include "core/geometry/scan.h"
#include "tools/synth/sequence.h"
#include "tools/synth/stations.h"

namespace lamina {

struct WrittenSequence {
  std::size_t frames = 0;
  std::size_t points = 0;
  std::string truth_path;
};

// Called now and then from the calling thread: scans written so far, of how many.
using SynthProgress = std::function<void(std::size_t done, std::size_t all)>;

// Writes into `directory`, which is created if need be:
//
//   velodyne/000000.bin ...   x y z intensity, float
//   times.txt                 stamps in seconds, exact to the ns
//   calib.txt                 P0..P3 and Tr, the identity: camera and LiDAR frame are the same
//   poses.txt                 T_world_lidar, exact ground truth
//
// The format has no time for each point: with `sweep`, a reader takes it from the azimuth (spinning
// sensors); avia's times are lost, use SynthScanSource for those. Throws OptionError for bad
// options, OutputError if something cannot be written or `velodyne` holds scans beyond the last one
// to be written, which would become part of the sequence. Bounded memory; the same bytes at any
// number of threads.
WrittenSequence WriteSequence(const SynthOptions& options, const std::string& directory,
                              const SynthProgress& progress = nullptr);

// The same for any scans: `truth` says how many, when and where. Scans are made by several threads
// at once. Not `timed`: without times.txt.
WrittenSequence WriteScans(const Trajectory& truth, const std::function<Scan(std::size_t)>& make,
                           const std::string& directory, const SynthProgress& progress,
                           bool timed = true);

enum class StationLayout { kKitti, kEthz };

// Stations (tools/synth/stations.h): as above, or in the layout of the ETHZ data set (Hokuyo_N.csv
// and pose_scanner_leica.csv); and reference.ply, the places on the surfaces that rays met, one for
// each voxel of 3 cm.
WrittenSequence WriteStations(const StationOptions& options, StationLayout layout,
                              const std::string& directory,
                              const SynthProgress& progress = nullptr);

}  // namespace lamina
