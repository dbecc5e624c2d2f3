// The clusters of one scan at rest: 40 bytes each, 60 if the scan carries time, in place of 120.
//
// Means are kept from their common centre, in single precision (packed_cluster.h): at 100 m from it
// to 4 micrometres. Clusters without points are left out.
#pragma once

#include <cstddef>
#include <vector>

#include "core/geometry/packed_cluster.h"

namespace lamina {

class PackedScan {
 public:
  PackedScan() = default;
  // Not explicit: what is put into memory for long is packed by being assigned.
  PackedScan(const std::vector<TimedCluster>& clusters) {  // NOLINT(google-explicit-constructor)
    bool timed = false;
    PointCluster all;
    for (const TimedCluster& c : clusters) {
      if (c.points.Empty()) continue;
      all += PointCluster{1.0, c.points.mean, {}};
      timed = timed || c.Timed();
    }
    centre_ = all.mean;
    const auto size = static_cast<std::size_t>(all.count);
    clusters_.reserve(size);
    if (timed) times_.reserve(size);
    for (const TimedCluster& c : clusters) {
      if (c.points.Empty()) continue;
      clusters_.push_back(PackedCluster::Of(c.points, centre_));
      if (timed) times_.push_back(TimesOf(c));
    }
  }

  std::size_t size() const { return clusters_.size(); }
  bool empty() const { return clusters_.empty(); }
  void clear() { *this = PackedScan(); }
  std::size_t bytes() const {
    return clusters_.capacity() * sizeof(PackedCluster) + times_.capacity() * sizeof(Times);
  }

  TimedCluster operator[](std::size_t i) const {
    TimedCluster cluster;
    cluster.points = clusters_[i].Unpacked(centre_);
    if (times_.empty()) return cluster;
    const Times& times = times_[i];
    const double n = cluster.points.count;
    cluster.mean_time_s = static_cast<double>(times.mean_s);
    cluster.time_scatter = n * static_cast<double>(times.variance);
    for (int axis = 0; axis < 3; ++axis) {
      cluster.point_time[axis] = n * static_cast<double>(times.covariance[axis]);
    }
    return cluster;
  }
  std::vector<TimedCluster> Unpacked() const {
    std::vector<TimedCluster> clusters;
    clusters.reserve(size());
    for (std::size_t i = 0; i < size(); ++i) clusters.push_back((*this)[i]);
    return clusters;
  }

 private:
  struct Times {  // s, s^2, m s
    float mean_s = 0.0F, variance = 0.0F;
    float covariance[3] = {0.0F, 0.0F, 0.0F};  // of the points with their times
  };
  static Times TimesOf(const TimedCluster& c) {
    Times times;
    times.mean_s = static_cast<float>(c.mean_time_s);
    times.variance = static_cast<float>(c.time_scatter / c.points.count);
    for (int axis = 0; axis < 3; ++axis) {
      times.covariance[axis] = static_cast<float>(c.point_time[axis] / c.points.count);
    }
    return times;
  }

  Eigen::Vector3d centre_ = Eigen::Vector3d::Zero();
  std::vector<PackedCluster> clusters_;
  std::vector<Times> times_;  // none if all are zero
};

}  // namespace lamina
