// Options from a shipped configuration, changed by name.
#include <lamina/backend/mapping/mapping.h>
#include <lamina/config/config.h>

#include <cstdio>

#include "room_scan.h"

int main() {
  const lamina::LaminaConfig config = lamina::LoadConfig("handheld", {"map.depth=2"});
  lamina::Mapping mapping(config.Mapping());
  for (int i = 0; i < 3; ++i) mapping.Add(RoomScan(i));
  mapping.Finish();
  std::printf("voxels of %.1f m, halved %d times; %zu scans\n", mapping.map().options().root_size_m,
              mapping.map().options().depth, mapping.counts().scans);
}
