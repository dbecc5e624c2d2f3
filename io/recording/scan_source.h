// Recordings on disk as ScanSource (core/geometry/scan_source.h): one function that opens every
// layout.
//
// Layouts that OpenScans recognises in a PATH, in this order:
//
//   KITTI odometry  PATH = .../sequences/NN, or its velodyne folder: `velodyne/*.bin`, `times.txt`
//                   (seconds), `calib.txt`; both text files may be missing
//   KITTI raw       PATH = a drive, or its velodyne_points folder: `velodyne_points/data/*.bin`
//                   (or *.txt), `velodyne_points/timestamps.txt` (date and time)
//   ETHZ            PATH holds Hokuyo_0.csv, Hokuyo_1.csv, ... (a header with x, y, z; commas or
//                   semicolons) and perhaps pose_scanner_leica.csv, whose timestamps count
//   plain folder    PATH holds files of points (*.bin, *.pcd, ...: io/points/scan_file.h), in the
//                   natural order of their names (scan2 before scan10), and perhaps a `times.txt`
//                   or `timestamps.txt`
//   a single scan   PATH is such a file, *.csv of ETHZ or *.txt of KITTI raw; its stamp is its name
//                   or that of its points
//
// Stamps come from times.txt / timestamps.txt where there is one (a line each scan; further lines
// are fine), else from file names that are whole numbers of nanoseconds, microseconds or
// milliseconds since the Unix epoch, or seconds with a decimal point, or end with these; else from
// a times.txt or timestamps.txt in the folder above that has a line for each scan; else from the
// points, if their times are readings of a clock (the earliest of a scan is its stamp); else from
// `frame_period_s`. Scans with stamps of their own, by name or by points, are in the order of
// these.
//
// PATH may as well be a container of messages (io/container/message_container.h): a ROS 1 bag, an
// MCAP file, a ROS 2 bag or a file of one. Its scans are the messages of one topic, in the order in
// which they were recorded; stamps are those of the messages. Or a capture of a sensor's packets
// (pcap, pcapng): its sweeps, see io/recording/capture_scans.h.
//
// With T_vehicle_lidar, PATH is the folder that holds those folders: io/recording/vehicle_scans.h.
#pragma once

#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <string>

#include "core/geometry/scan_source.h"
#include "core/options/options.h"
#include "io/points/point_times.h"

namespace lamina {

struct ScanSourceOptions {
  // Time between scans where the recording carries no stamps.
  double frame_period_s = 0.1;
  // Unit of a per-point time field of PCD and PLY files and of messages. kAuto: the one that makes
  // the scan last about as long as scans do, between 1 ms and 10 s.
  PointTimeUnit point_time_unit = PointTimeUnit::kAuto;
  // The topic of the scans in a container of messages. Empty: the only one that holds scans.
  std::string topic;
  // Where sensors are on their vehicle, by the folders of their scans: see
  // io/recording/vehicle_scans.h.
  std::map<std::string, SE3> T_vehicle_lidar;

  void Visit(OptionVisitor& v);
};

// Whether OpenScans takes `path` as a container of messages. Files of scans count before one that
// lies among them.
bool HoldsMessages(const std::string& path);

// Throws InputError if the path is missing, unreadable, or holds no scans, or if its stamps or
// calibration are unusable.
std::unique_ptr<ScanSource> OpenScans(const std::string& path, const ScanSourceOptions& options);

// Reads one point file of a recording that gives it this stamp, as ScanSource::Read does.
// `recorded_stamp` is false for stamps that are made up: no clock of the points is held against
// them. Throws InputError.
Scan ReadStampedScan(const std::string& path, StampNs stamp_ns, bool recorded_stamp,
                     const ScanSourceOptions& options);

// Gives a scan, whose stamp_ns is as its file leaves it (io/points/scan_file.h), the stamp of its
// recording: see ScanSource::Read.
void GiveStamp(StampNs stamp_ns, bool recorded_stamp, Scan* scan);

// The stamp of scan i where the recording carries none: i * frame_period_s.
StampNs MadeUpStamp(std::size_t i, const ScanSourceOptions& options);

// T_camera_lidar from the line "Tr:" (12 numbers, row-major 3x4) of a KITTI calib.txt; nothing if
// there is no such line. Throws InputError naming file and line.
std::optional<SE3> ReadKittiCalibration(const std::string& path);

}  // namespace lamina
