// Sensors on one vehicle: the scans of each are in a folder of their own, and the option
//
//     scans.T_vehicle_lidar:   front: [x, y, z, qx, qy, qz, qw]      p_vehicle = T * p_lidar
//
// tells where it is. The name is that of the folder, or the last parts of its path: `front` means
// `drive1/front` and `drive2/front` of an inbox. Folders so named that lie in the same folder
// belong to one vehicle: they are one recording, in the order of their stamps, which must be of one
// clock and at least 10 ms apart: from two poses nearer in time no velocity can be told, so of
// sensors that are triggered together the scans of one are mapped, and the others' skipped. Each is
// matched by itself, so their views must have something in common.
// Each scan stays one of its own, with its sensor's ranges, angles and times; its points are
// brought into the frame of the vehicle when it is prepared, so all poses are T_world_vehicle.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "io/recording/scan_source.h"

namespace lamina {

struct SensorMount {
  // The recording: the folder above, with a slash at the end, as the name of no folder has.
  std::string vehicle;
  SE3 T_vehicle_lidar;
};

// Where the sensor is whose scans are in `folder` (relative to inbox or recording); nothing if it
// is not on a vehicle. Of several names that fit the longest counts. Thread-safe.
std::optional<SensorMount> FindMount(const std::map<std::string, SE3>& T_vehicle_lidar,
                                     const std::string& folder);

// The scans of all sensors of a recorded vehicle: PATH/FOLDER for each folder that is named.
class VehicleScans final : public ScanSource {
 public:
  // Throws InputError, naming the option, if a folder is missing or has no stamps: nothing else
  // tells the order of two sensors' scans.
  VehicleScans(const std::string& path, const ScanSourceOptions& options);

  std::size_t size() const override { return order_.size(); }
  std::string Name(std::size_t i) const override { return Of(i).Name(order_.at(i).scan); }
  StampNs Stamp(std::size_t i) const override { return Of(i).Stamp(order_.at(i).scan); }
  std::string Sensor(std::size_t i) const override { return sensors_[order_.at(i).sensor].folder; }
  SE3 T_vehicle_lidar(std::size_t i) const override;
  std::vector<StampNs> StampsUpTo(std::size_t i, std::size_t begin,
                                  std::size_t most) const override;
  std::optional<StampNs> StampAfter(std::size_t i) const override;
  Scan Read(std::size_t i) const override { return Of(i).Read(order_.at(i).scan); }
  PointTimeField PointTimes(std::size_t i) const override {
    return Of(i).PointTimes(order_.at(i).scan);
  }
  bool recorded_stamps() const override;
  RecordingDescription Describe() const override;

 private:
  struct OneSensor {
    std::string folder;
    SE3 T_vehicle_lidar;
    std::unique_ptr<ScanSource> scans;
    std::vector<std::size_t> order;  // numbers of its scans here
  };
  struct Place {
    std::size_t sensor = 0, scan = 0;  // scan of that sensor
    std::size_t rank = 0;              // in the order of its stamps
  };
  const ScanSource& Of(std::size_t i) const { return *sensors_[order_.at(i).sensor].scans; }

  std::vector<OneSensor> sensors_;
  std::vector<Place> order_;
};

}  // namespace lamina
