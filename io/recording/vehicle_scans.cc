#include "io/recording/vehicle_scans.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "core/base/error.h"

namespace lamina {
namespace {

bool IsFolderOrEndsWith(const std::string& folder, const std::string& name) {
  if (folder == name) return true;
  const std::string end = "/" + name;
  return folder.size() > end.size() &&
         folder.compare(folder.size() - end.size(), end.size(), end) == 0;
}

}  // namespace

std::optional<SensorMount> FindMount(const std::map<std::string, SE3>& T_vehicle_lidar,
                                     const std::string& folder) {
  const std::pair<const std::string, SE3>* found = nullptr;
  for (const auto& mount : T_vehicle_lidar) {
    if (!IsFolderOrEndsWith(folder, mount.first)) continue;
    if (found == nullptr || mount.first.size() > found->first.size()) found = &mount;
  }
  if (found == nullptr) return std::nullopt;
  const std::string above = folder.substr(0, folder.size() - found->first.size());
  return SensorMount{above.empty() ? "/" : above, found->second};
}

VehicleScans::VehicleScans(const std::string& path, const ScanSourceOptions& options) {
  ScanSourceOptions of_sensor = options;
  of_sensor.T_vehicle_lidar.clear();
  for (const auto& [folder, T_vehicle_lidar] : options.T_vehicle_lidar) {
    const std::string scans = (std::filesystem::path(path) / folder).string();
    OneSensor sensor{folder, T_vehicle_lidar, nullptr, {}};
    try {
      sensor.scans = OpenScans(scans, of_sensor);
    } catch (const InputError& error) {
      throw InputError(
          fmt::format("{} (a sensor by scans.T_vehicle_lidar.{})", error.what(), folder));
    }
    if (options.T_vehicle_lidar.size() > 1 && !sensor.scans->recorded_stamps()) {
      throw InputError(fmt::format(
          "{}: has no stamps, which the sensors of scans.T_vehicle_lidar need: scans of several "
          "are put in order by them",
          scans));
    }
    sensors_.push_back(std::move(sensor));
  }
  for (std::size_t s = 0; s < sensors_.size(); ++s) {
    for (std::size_t i = 0; i < sensors_[s].scans->size(); ++i) order_.push_back({s, i, 0});
  }
  std::stable_sort(order_.begin(), order_.end(), [this](const Place& a, const Place& b) {
    return sensors_[a.sensor].scans->Stamp(a.scan) < sensors_[b.sensor].scans->Stamp(b.scan);
  });
  for (std::size_t i = 0; i < order_.size(); ++i) {
    std::vector<std::size_t>& order = sensors_[order_[i].sensor].order;
    order_[i].rank = order.size();
    order.push_back(i);
  }
}

SE3 VehicleScans::T_vehicle_lidar(std::size_t i) const {
  return sensors_[order_.at(i).sensor].T_vehicle_lidar;
}

std::vector<StampNs> VehicleScans::StampsUpTo(std::size_t i, std::size_t begin,
                                              std::size_t most) const {
  const Place& place = order_.at(i);
  const std::vector<std::size_t>& order = sensors_[place.sensor].order;
  std::vector<StampNs> stamps;
  for (std::size_t k = place.rank + 1; k-- > 0 && stamps.size() < most && order[k] >= begin;) {
    stamps.push_back(Stamp(order[k]));
  }
  std::reverse(stamps.begin(), stamps.end());
  return stamps;
}

std::optional<StampNs> VehicleScans::StampAfter(std::size_t i) const {
  const Place& place = order_.at(i);
  const std::vector<std::size_t>& order = sensors_[place.sensor].order;
  if (place.rank + 1 < order.size()) return Stamp(order[place.rank + 1]);
  return std::nullopt;
}

bool VehicleScans::recorded_stamps() const {
  return std::all_of(sensors_.begin(), sensors_.end(),
                     [](const OneSensor& sensor) { return sensor.scans->recorded_stamps(); });
}

RecordingDescription VehicleScans::Describe() const {
  RecordingDescription all;
  bool same_stamps = true;
  std::string stamps_of_each;
  for (const OneSensor& sensor : sensors_) {
    const RecordingDescription one = sensor.scans->Describe();
    const bool first = &sensor == &sensors_.front();
    if (first) all.stamps = one.stamps;
    same_stamps = same_stamps && one.stamps == all.stamps;
    const char* separator = first ? "" : "; ";
    all.scans += fmt::format("{}{}: {}", separator, sensor.folder, one.scans);
    stamps_of_each += fmt::format("{}{}: {}", separator, sensor.folder, one.stamps);
    for (const std::string& doubt : one.doubts) {
      all.doubts.push_back(fmt::format("{}: {}", sensor.folder, doubt));
    }
  }
  if (sensors_.size() > 1) all.scans += "; all in the order of their stamps";
  if (!same_stamps) all.stamps = stamps_of_each;
  return all;
}

}  // namespace lamina
