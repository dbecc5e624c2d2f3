// A stand-in for the mapping thread: a street of surfels, and a sensor that drives along it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <mutex>
#include <tuple>
#include <utility>
#include <vector>

#include "tools/watch/live/view.h"
#include "tools/watch/live/wire.h"

namespace lamina {

// Ground and two walls along x, a surfel every `spacing_m`. Thread-safe.
class LiveWorld {
 public:
  static constexpr double kCellM = 1.6;
  static constexpr std::size_t kPageSurfels = 20000;

  LiveWorld(double length_m, double spacing_m) {
    for (double x = -10.0; x < length_m; x += spacing_m) {
      for (double y = -8.0; y < 8.0; y += spacing_m) Add({x, y, 0.0}, {0, 0, 1}, spacing_m);
      for (double z = 0.2; z < 6.0; z += spacing_m) {
        Add({x, -8.0, z}, {0, 1, 0}, spacing_m);
        Add({x, 8.0, z}, {0, -1, 0}, spacing_m);
      }
    }
  }

  std::size_t size() const { return surfels_; }

  // A surfel that was not there when the world was made.
  void Grow(const Eigen::Vector3d& centre) {
    const std::lock_guard lock(mutex_);
    ++version_;
    Add(centre, {0, 0, 1}, 0.5);
  }

  MapPage Answer(const MapQuery& query) const {
    const std::lock_guard lock(mutex_);
    std::vector<std::pair<double, const Cell*>> near;
    for (const auto& [place, cell] : cells_) {
      const double distance = (CentreOf(cell.cell) - query.centre).norm();
      if (distance <= query.radius_m && cell.version > query.newer_than) {
        near.emplace_back(distance, &cell);
      }
    }
    std::sort(near.begin(), near.end());
    MapPage page;
    page.cell_size_m = kCellM;
    page.version = version_;
    std::size_t seen = 0;
    for (const auto& [distance, cell] : near) {
      const std::size_t at = seen / kPageSurfels;
      seen += cell->cell.surfels.size();
      if (at == query.page) page.cells.push_back(cell->cell);
      if (at > query.page) page.next = query.page + 1;
    }
    return page;
  }

  // Frame i, driven at 1 m a frame.
  static LiveFrame Frame(std::int64_t i) {
    LiveFrame frame;
    frame.pose.index = i;
    frame.pose.stamp_ns = i * 100000000;
    const double s = static_cast<double>(i);
    frame.pose.T_world_lidar =
        SE3(ExpSO3({0.0, 0.0, 0.1 * std::sin(0.1 * s)}), {s, 2.0 * std::sin(0.05 * s), 1.7});
    const auto wave = [&](double base, double swing) {
      return static_cast<float>(base + swing * std::sin(0.7 * s) * std::sin(0.31 * s));
    };
    frame.times = {wave(38, 9), wave(1, 0.3), wave(3, 0.6), wave(4, 1),
                   wave(10, 3), wave(2, 0.5), wave(4, 2),   wave(1.5, 0.7)};
    return frame;
  }

  static LiveScan Scan(std::int64_t i) {
    LiveScan scan;
    scan.index = i;
    scan.origin = Frame(i).pose.T_world_lidar.t;
    for (int k = 0; k < 2000; ++k) {
      const auto angle = static_cast<float>(0.0031416 * k);
      const float range = 3.0F + 4.0F * static_cast<float>(k % 10) / 10.0F;
      scan.points.emplace_back(range * std::cos(angle), range * std::sin(angle), -1.6F);
    }
    return scan;
  }

 private:
  struct Cell {
    MapCell cell;
    std::int64_t version = 0;
  };

  static Eigen::Vector3d CentreOf(const MapCell& cell) {
    return kCellM * (Eigen::Vector3d(cell.ix, cell.iy, cell.iz).array() + 0.5).matrix();
  }

  void Add(const Eigen::Vector3d& centre, const Eigen::Vector3f& normal, double spacing_m) {
    const auto index = [&](int k) {
      return static_cast<std::int32_t>(std::floor(centre[k] / kCellM));
    };
    Cell& cell = cells_[{index(0), index(1), index(2)}];
    cell.cell.ix = index(0);
    cell.cell.iy = index(1);
    cell.cell.iz = index(2);
    cell.version = version_;
    const double thickness_m = 0.02 + 0.02 * std::sin(0.2 * centre.x());
    // The spread along the plane that makes discs of about the spacing.
    const auto spread = static_cast<float>(0.1 * spacing_m * spacing_m);
    Surfel surfel{
        centre, normal, {spread, spread, static_cast<float>(thickness_m * thickness_m)}, 30};
    surfel.last_keyframe = static_cast<std::int64_t>(std::max(0.0, centre.x()));
    cell.cell.surfels.push_back(surfel);
    ++surfels_;
  }

  mutable std::mutex mutex_;
  std::map<std::tuple<std::int32_t, std::int32_t, std::int32_t>, Cell> cells_;
  std::int64_t version_ = 1;
  std::size_t surfels_ = 0;
};

}  // namespace lamina
