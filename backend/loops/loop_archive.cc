// The state of loop closure, written and read (core/geometry/state_archive.h).
#include "backend/loops/loop_closure.h"
#include "backend/places/submap_pairs.h"

namespace lamina {

void PlaceImage::Archive(StateArchive& a) {
  a(&T_level_submap, &cells, &polar);
  ground.resize(a.Size(ground.size(), sizeof(float)));
  for (Ground& g : ground) a(&g.x, &g.y, &g.height_m);
}

void Loop::Archive(StateArchive& a) {
  a(&status, &solved, &reason, &from, &to, &score, &way_m);
  lamina::Archive(a, &match);
}

void LoopClosure::Archive(StateArchive& a) {
  submaps_.resize(a.Size(submaps_.size(), 1));
  for (Submap& submap : submaps_) submap.ArchiveBeside(store_, a);
  a(&anchors_, &corrected_, &loops_, &trimmed_, &cost_before_, &cost_);
  places_.resize(submaps_.size());
  for (Place& place : places_) a(&place.image, &place.way_m);
}

}  // namespace lamina
