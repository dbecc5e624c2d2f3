// What a sensor sees that moves through a room: the program's own data.
#pragma once

#include <lamina/core/geometry/scan.h>

#include <cmath>

// Scan i of a sensor that has moved by 0.1 m x i along x, in a room of 12 x 8 x 3 m.
inline lamina::Scan RoomScan(int i) {
  const double x = 0.1 * i;
  lamina::Scan scan;
  scan.stamp_ns = 100'000'000LL * i;
  for (int ring = -8; ring <= 8; ++ring) {
    for (int step = 0; step < 360; ++step) {
      const double elevation = 0.04 * ring, azimuth = step * M_PI / 180.0 + 0.01 * ring;
      const double dx = std::cos(elevation) * std::cos(azimuth);
      const double dy = std::cos(elevation) * std::sin(azimuth);
      const double dz = std::sin(elevation);
      const double to_x = dx > 0.0 ? (6.0 - x) / dx : dx < 0.0 ? (-6.0 - x) / dx : 1e9;
      const double to_y = dy > 0.0 ? 4.0 / dy : dy < 0.0 ? -4.0 / dy : 1e9;
      const double to_z = dz > 0.0 ? 1.5 / dz : dz < 0.0 ? -1.5 / dz : 1e9;
      const double range = std::fmin(to_x, std::fmin(to_y, to_z));
      scan.points.push_back({static_cast<float>(range * dx), static_cast<float>(range * dy),
                             static_cast<float>(range * dz), 0.0F});
    }
  }
  return scan;
}
