// Where the scans of a recording come from, whatever holds them: what mapping asks of files
// (io/recording/scan_source.h), of an inbox, or of a program's own storage.
#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/scan.h"

namespace lamina {

// What was understood of a recording, in words for people.
struct RecordingDescription {
  std::string scans;                // "88 files *.pcd, in the order of their names"
  std::string stamps;               // where they come from
  std::vector<std::string> doubts;  // what contradicts, or was passed over
};

// Per-point times of a scan: their field, the unit that it was taken to have, and whether it holds
// readings of a clock or offsets from the stamp.
struct PointTimeField {
  std::string name;  // empty: the scan has none
  const char* unit = "";
  bool clock = false;
  // It tells points apart: not all times are the same, and their type resolves them.
  bool usable = false;
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

  // What was understood of the times of scan i's points. Reads it: throws InputError as Read does.
  virtual PointTimeField PointTimes(std::size_t) const { return {}; }

  // Whether the recording itself says that its sensor turns, a ring for each beam.
  virtual bool spins() const { return false; }

  // False if stamps are made up from frame_period_s.
  virtual bool recorded_stamps() const { return true; }

  virtual RecordingDescription Describe() const { return {}; }

  // T_camera_lidar of KITTI odometry's calib.txt ("Tr:"); identity where there is none.
  virtual SE3 T_camera_lidar() const { return SE3(); }
};

}  // namespace lamina
