// Lamina from a program of one's own: scans in, poses and a map out.
#include <lamina/backend/mapping/mapping.h>

#include <cstdio>

#include "room_scan.h"

int main() {
  lamina::Mapping mapping;
  for (int i = 0; i < 20; ++i) {
    const lamina::MappedScan mapped = mapping.Add(RoomScan(i));
    const Eigen::Vector3d t = mapped.odometry.T_world_lidar.t;
    std::printf("scan %d: %s, x %.3f m\n", i, lamina::StatusName(mapped), t.x());
  }
  mapping.Finish();
  int surfels = 0;
  mapping.map().ForEachSurface(2, [&](const lamina::Surfel&) { ++surfels; });
  std::printf("%d surfels\n", surfels);
}
