// Where scans come from: one interface for every layout of files on disk.
//
// Layouts that OpenScans recognises in a PATH, in this order:
//
//   KITTI odometry  PATH = .../sequences/NN, or its velodyne folder: `velodyne/*.bin`, `times.txt`
//                   (seconds), `calib.txt`; both text files may be missing
//   KITTI raw       PATH = a drive, or its velodyne_points folder: `velodyne_points/data/*.bin`
//                   (or *.txt), `velodyne_points/timestamps.txt` (date and time)
//   ETHZ            PATH holds Hokuyo_0.csv, Hokuyo_1.csv, ... (a header with x, y, z; commas or
//                   semicolons) and perhaps pose_scanner_leica.csv, whose timestamps count
//   plain folder    PATH holds files *.bin, *.pcd or *.ply, in the natural order of their names
//                   (scan2 before scan10), and perhaps a `times.txt` or `timestamps.txt`
//
// Stamps come from times.txt / timestamps.txt where there is one (a line each scan; further lines
// are fine), else from file names that are whole numbers of nanoseconds, microseconds or
// milliseconds since the Unix epoch, or seconds with a decimal point; else from a times.txt or
// timestamps.txt in the folder above that has a line for each scan; else from the points, if their
// times are readings of a clock (the earliest of a scan is its stamp); else from `frame_period_s`.
// Scans with stamps of their own, by name or by points, are in the order of these.
//
// With T_vehicle_lidar, PATH is the folder that holds those folders: io/recording/vehicle_scans.h.
#pragma once

#include <algorithm>
#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/scan.h"
#include "core/options/options.h"

namespace lamina {

struct ScanSourceOptions {
  // Time between scans where the recording carries no stamps.
  double frame_period_s = 0.1;
  // Unit of a per-point time field of PCD and PLY files. kAuto: the one that makes the scan last
  // about as long as scans do, between 1 ms and 10 s.
  enum class TimeUnit { kAuto, kSeconds, kMilliseconds, kMicroseconds, kNanoseconds };
  TimeUnit point_time_unit = TimeUnit::kAuto;
  // Where sensors are on their vehicle, by the folders of their scans: see
  // io/recording/vehicle_scans.h.
  std::map<std::string, SE3> T_vehicle_lidar;

  void Visit(OptionVisitor& v);
};

// What was understood of a recording, in words for people.
struct RecordingDescription {
  std::string scans;                // "88 files *.pcd, in the order of their names"
  std::string stamps;               // where they come from
  std::vector<std::string> doubts;  // what contradicts, or was passed over
};

// Random access to the scans of a recording. Thread-safe: all members may be called at once.
class ScanSource {
 public:
  virtual ~ScanSource() = default;

  virtual std::size_t size() const = 0;

  // Name of the file behind scan i, for messages.
  virtual std::string Name(std::size_t i) const = 0;

  // Stamp of scan i, known without reading its points. Not promised to increase: that is for the
  // pipeline to judge.
  virtual StampNs Stamp(std::size_t i) const = 0;

  // The recording that scan i is of: scans of one clock and one sensor, or of the sensors of one
  // vehicle, which follow one another. Those of several may alternate.
  virtual std::string Recording(std::size_t) const { return ""; }
  // Its sensor: the recording, or one of those on the vehicle.
  virtual std::string Sensor(std::size_t i) const { return Recording(i); }
  // Where the sensor of scan i is on its vehicle, whose poses are wanted.
  virtual SE3 T_vehicle_lidar(std::size_t) const { return SE3(); }

  // Stamps of scan i and of those of its sensor before it, at most `most` in all and none before
  // scan `begin`, in order.
  virtual std::vector<StampNs> StampsUpTo(std::size_t i, std::size_t begin,
                                          std::size_t most) const {
    std::vector<StampNs> stamps;
    for (std::size_t k = std::max(begin, i + 1 >= most ? i + 1 - most : 0); k <= i; ++k) {
      stamps.push_back(Stamp(k));
    }
    return stamps;
  }

  // Stamp of the scan of its sensor after i, if it is known by now: from these two the period of a
  // sweep is learned when there is none before.
  virtual std::optional<StampNs> StampAfter(std::size_t i) const {
    if (i + 1 < size()) return Stamp(i + 1);
    return std::nullopt;
  }

  // Reads scan i as it stands in the file: no filtering, non-finite points included. Its stamp is
  // Stamp(i), and time_s counts from there. Where the file's point times are readings of a clock,
  // they are brought to Stamp(i) if the recording's own stamps are of that clock (within 10 s), and
  // else count from the scan's earliest point. Throws InputError naming file, place and rule
  // (missing, truncated, not a point file, no points, ...).
  virtual Scan Read(std::size_t i) const = 0;

  // False if stamps are made up from frame_period_s.
  virtual bool recorded_stamps() const { return true; }

  virtual RecordingDescription Describe() const { return {}; }

  // T_camera_lidar of KITTI odometry's calib.txt ("Tr:"); identity where there is none.
  virtual SE3 T_camera_lidar() const { return SE3(); }
};

// Throws InputError if the path is missing, unreadable, or holds no scans, or if its stamps or
// calibration are unusable.
std::unique_ptr<ScanSource> OpenScans(const std::string& path, const ScanSourceOptions& options);

// Per-point times of a file: its field, the unit that it was taken to have, and whether it holds
// readings of a clock or offsets from the stamp.
struct PointTimeField {
  std::string name;  // empty: the file has none
  const char* unit = "";
  bool clock = false;
  // It tells points apart: not all times are the same, and their type resolves them.
  bool usable = false;
};

// Reads one point file by its ending: .bin, .pcd, .ply or .csv (KITTI raw's .txt too). stamp_ns of
// the result is 0 unless the file itself carries per-point readings of a clock (times more than 60
// s from zero): then it is the earliest of them. Throws InputError. `times`, if
// not null, becomes what was understood of the points' times.
Scan ReadScanFile(const std::string& path, const ScanSourceOptions& options,
                  PointTimeField* times = nullptr);

// Reads one point file of a recording that gives it this stamp, as ScanSource::Read does.
// `recorded_stamp` is false for stamps that are made up: no clock of the points is held against
// them. Throws InputError.
Scan ReadStampedScan(const std::string& path, StampNs stamp_ns, bool recorded_stamp,
                     const ScanSourceOptions& options);

// The stamp of scan i where the recording carries none: i * frame_period_s.
StampNs MadeUpStamp(std::size_t i, const ScanSourceOptions& options);

// T_camera_lidar from the line "Tr:" (12 numbers, row-major 3x4) of a KITTI calib.txt; nothing if
// there is no such line. Throws InputError naming file and line.
std::optional<SE3> ReadKittiCalibration(const std::string& path);

}  // namespace lamina
