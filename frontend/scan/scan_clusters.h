// The points of one scan, gathered into clusters by leaf voxel of the LiDAR frame.
//
// After this step no raw point is touched again: matching, deskewing, the map and the bundle
// adjustment all work on the clusters. One pass over the points, one hash look-up for each.
#pragma once

#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/scan.h"
#include "frontend/scan/scan_preparation.h"

namespace lamina {

// In the order in which the points first met the voxels. leaf_size_m > 0; points must lie within
// 2^20 leaves of the origin (the range filter sees to that). Pure function; thread-safe.
std::vector<TimedCluster> BuildScanClusters(const std::vector<TimedPoint>& points,
                                            double leaf_size_m);

// Clusters gathered into larger voxels, by their means: those of the points themselves but for
// clusters that straddle a face. (*group_of)[i], if asked for, says which of them clusters[i] is
// in.
std::vector<TimedCluster> MergeClusters(const std::vector<TimedCluster>& clusters,
                                        double leaf_size_m,
                                        std::vector<std::size_t>* group_of = nullptr);

// The points of each of these clusters, for the few who ask for points after all.
std::vector<std::vector<TimedPoint>> GroupByCluster(const std::vector<TimedPoint>& points,
                                                    double leaf_size_m);

// All clusters in the LiDAR frame at the scan's reference instant (core/geometry/sweep_motion.h),
// tau = 0, for a sensor that moves like this during the scan. result[i] belongs to clusters[i].
// With the sensor's twist [w; v] and pose T at an instant, the change [a; b] of the twist, s = tau
// - that instant and
//
//     c = w x mu + v,
//     p' = T (p + s (w x p + v) + s^2/2 (w x (w x p + v) + a x p + b) + ...)
//
// The scatter is that of the right side to first order in s. The mean is carried further, since
// what is left out of it does not average away over clusters: it lies on the same side of every
// surface. Its terms of even order are those of times spread evenly, E[s^4] = 9/5 E[s^2]^2, whose
// sum is s^2/2 (1 - |w|^2 E[s^2] 9/60) w x c; of odd order, that of the moments alone. At 20
// degrees within a cluster of 0.1 s, 20 m away, 0.1 mm remain.
//
// The instant is the nearest to the cluster's mean time of 128 that divide the sweep: its scatter
// is turned by w times half of one division less or more, 0.05 degrees at 140 deg/s.
std::vector<PointCluster> DeskewClusters(const std::vector<TimedCluster>& clusters,
                                         const SweepMotion& motion);
// The same into memory that is there already.
void DeskewClusters(const std::vector<TimedCluster>& clusters, const SweepMotion& motion,
                    std::vector<PointCluster>* result);

// As of a sensor that rests.
std::vector<PointCluster> Undeskewed(const std::vector<TimedCluster>& clusters);

// Moves the reference instant to the middle of the sweep. Returns where that is, nanoseconds after
// the instant from which times counted; 0 if there are no clusters.
StampNs CentreTimes(std::vector<TimedCluster>* clusters);

// Seconds between the first cluster's time and the last one's; 0 if there are none.
double SweepLength(const std::vector<TimedCluster>& clusters);

// Whether any cluster was measured at another instant than the reference instant.
bool AnyTimed(const std::vector<TimedCluster>& clusters);

}  // namespace lamina
