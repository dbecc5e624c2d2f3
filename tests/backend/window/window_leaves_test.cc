// Clusters of a window in the leaves of its map, which Move() leaves as they are.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "backend/window/sliding_window.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

std::vector<WindowFrame> FramesOfClouds(int count, Draws* draws) {
  std::vector<WindowFrame> frames;
  for (int i = 0; i < count; ++i) {
    WindowFrame& frame = frames.emplace_back();
    frame.id = i;
    frame.stamp_ns = i * StampNs{100'000'000};
    frame.T_world_lidar = draws->Offset(0.2, 1.0);
    for (int k = 0; k < 200; ++k) {
      frame.measured.emplace_back();
      frame.measured.back().points = ClusterOf(draws->Cloud(8, draws->InCube(6.0), 0.2));
    }
  }
  return frames;
}

std::vector<std::string> SurfacesOf(const VoxelMap& map) {
  std::vector<std::string> surfaces;
  map.ForEachSurface(1, [&](Surfel s) {
    StateArchive a;
    a(&s.centre, &s.normal, &s.count);
    surfaces.push_back(a.written());
  });
  std::sort(surfaces.begin(), surfaces.end());
  return surfaces;
}

TEST(WindowLeaves, AddedAnewClustersAreWhereTheyLie) {
  Draws draws(3);
  const VoxelMapOptions options;
  std::vector<WindowFrame> frames = FramesOfClouds(3, &draws);
  VoxelMap map(options), as_moved(options);
  SlidingWindow window({}, &map), other({}, &as_moved);
  for (const WindowFrame& frame : frames) window.Push(frame);
  map.Refresh();
  EXPECT_EQ(window.ShareAstray(), 0.0);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    frames[i].T_world_lidar = frames[i].T_world_lidar * draws.Offset(0.3, 1.0);
    window.Move(i, frames[i].T_world_lidar, {});
    other.Push(frames[i]);
  }
  map.Refresh();
  as_moved.Refresh();
  EXPECT_GT(window.ShareAstray(), 0.3);
  EXPECT_NE(SurfacesOf(map), SurfacesOf(as_moved));

  std::vector<VoxelKey> roots;
  for (const WindowFrame& frame : window.frames()) {
    for (const VoxelMap::LeafAddress& address : frame.addresses) roots.push_back(address.root);
  }
  map.DropPiece(0, roots);
  map.BeginPiece(0);
  window.AddAnew();
  map.Refresh();
  EXPECT_EQ(window.ShareAstray(), 0.0);
  EXPECT_EQ(SurfacesOf(map), SurfacesOf(as_moved));
}

}  // namespace
}  // namespace lamina
