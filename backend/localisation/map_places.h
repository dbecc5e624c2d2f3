// Places of a finished map: what it has around points of the ways that sensors took through it.
//
// A place is described (place_image.h) and registered against as a submap is, but holds all that
// the map has within a radius of it, whichever keyframes saw it; it is read out of the map when it
// is needed. Neighbouring places overlap: one of them is near the middle of any short way.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "backend/loops/loop_closure.h"
#include "backend/submaps/submap.h"
#include "core/geometry/se3.h"
#include "core/geometry/state_archive.h"
#include "core/map/voxel_map.h"

namespace lamina {

struct MapPlace {
  std::int64_t piece = 0;
  Eigen::Vector3d at = Eigen::Vector3d::Zero();  // of the sensor, in the frame of the piece

  void Archive(StateArchive& a) { a(&piece, &at); }
};

// Adds places of a piece along a way, so that each point of it is within `spacing_m` of one.
void AddPlaces(std::int64_t piece, const std::vector<Eigen::Vector3d>& way, double spacing_m,
               std::vector<MapPlace>* places);

// The frame of a place in that of its piece: parallel to it, on the grid of the map's voxels.
SE3 PlaceFrame(const MapPlace& place, const VoxelMapOptions& map);

// What the map has within `radius_m` of a place, in a frame that is parallel to the piece's and
// whose voxels are those of the map. One keyframe, at the place. Depends on what the map holds
// alone, in memory or in its store.
Submap SubmapAround(const MapPlace& place, double radius_m, const VoxelMap& map);

// Where places are read from: a map, or the submaps of pieces at their present anchors, which are
// put together around each place when it is needed. What it reads must outlive it. Thread-safe as
// long as that does not change.
class PlaceSource {
 public:
  using Pieces = std::map<std::int64_t, const LoopClosure*>;

  PlaceSource(const VoxelMap& map) : map_(&map), options_(map.options()) {}  // NOLINT: a view
  // `ambiguous`: pieces of which what they have lies in more than one place of another piece.
  PlaceSource(Pieces pieces, const VoxelMapOptions& options, std::set<std::int64_t> ambiguous = {})
      : pieces_(std::move(pieces)), ambiguous_(std::move(ambiguous)), options_(options) {}

  const VoxelMapOptions& options() const { return options_; }
  bool Ambiguous(std::int64_t piece) const { return ambiguous_.count(piece) > 0; }
  // Whether two pieces may turn out to have the same place. Those of a finished map are apart
  // because joining found no reason to join them.
  bool MayBeOne(std::int64_t a, std::int64_t b) const {
    return map_ == nullptr && a != b && !Ambiguous(a) && !Ambiguous(b);
  }
  Submap Around(const MapPlace& place, double radius_m) const;

 private:
  const VoxelMap* map_ = nullptr;
  Pieces pieces_;
  std::set<std::int64_t> ambiguous_;
  VoxelMapOptions options_;
};

}  // namespace lamina
