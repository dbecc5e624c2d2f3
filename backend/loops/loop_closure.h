// Loops between the submaps of one piece, and the anchors that agree with them.
//
//     submap complete
//       -> described (place_image.h), looked up among the earlier ones (place_lookup.h)
//       -> registered (submap_registration.h)
//       -> within the drift of odometry
//       -> agrees with a loop of another submap, or with the graph that those have made
//       -> anchors solved (anchor_graph.h)
//       -> submaps that the map can do without are trimmed (submap_trimming.h)
//
// A loop is accepted when all of that holds; until another one agrees with it, it waits. Odometry's
// edges join successive submaps; their sigmas are the drift that options expect of the way.
//
// Submaps come one by one, and each correction is complete when Add() returns. Memory: some 50 kB a
// submap for its image, 48 bytes a leaf of submaps that are not stored, 128 bytes a trimmed submap.
// Not thread-safe; same bits at any number of threads.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "backend/loops/anchor_correction.h"
#include "backend/loops/loop.h"
#include "backend/loops/loop_options.h"
#include "backend/loops/submap_trimming.h"
#include "backend/places/place_lookup.h"
#include "core/map/voxel_map.h"
#include "frontend/matching/scan_matcher.h"

namespace lamina {

class LoopClosure {
 public:
  // Throws OptionError. `map`, `matcher`: as in mapping. `store`: where the leaves of submaps are
  // that come with leaves stored; outlives this.
  LoopClosure(const LoopOptions& options, const VoxelMapOptions& map,
              const ScanMatcherOptions& matcher, const ByteStore* store = nullptr);
  ~LoopClosure();

  // The next submap; its anchor as odometry has it. Leaves that are stored leave memory.
  void Add(Submap submap);

  // Without those that were trimmed: ids ascend, with gaps. The newest is among them.
  const std::vector<Submap>& submaps() const { return submaps_; }
  // Present anchors, corrected.
  const std::vector<SE3>& anchors() const { return anchors_; }
  // Whether a loop has moved any.
  bool corrected() const { return corrected_; }
  // Between these submaps.
  const std::vector<Loop>& loops() const { return loops_; }
  // In the order of their stamps.
  const std::vector<TrimmedSubmap>& trimmed() const { return trimmed_; }
  // Of a submap, from above.
  const PlaceImage& image(std::size_t submap) const { return places_[submap].image; }
  // Odometry's edges and the accepted loops, at the present anchors.
  AnchorGraph graph() const;
  // Sums of squared residuals of that graph before any correction and now.
  double cost_before() const { return cost_before_; }
  double cost() const { return cost_; }

  // All of it; reading, into one of the same options.
  void Archive(StateArchive& a);

 private:
  struct Place {
    PlaceImage image;
    double way_m = 0.0;  // of the sensor, from the first submap's begin to this one's
  };
  class Targets;
  struct Hypothesis {
    std::size_t other = 0;
    SE3 T_other_query;
    double score = 0.0;
    bool predicted = false;
  };

  // Ways from the newest submap to each, along edges and accepted loops.
  std::vector<double> Ways() const;
  std::vector<Hypothesis> Hypotheses(const std::vector<double>& ways) const;
  void FindLoops(const SubmapQuery& query);
  std::string DriftRefusal(const Loop& loop) const;
  bool Agree(const Loop& a, const Loop& b) const;
  bool AgreesWithGraph(const Loop& loop) const;
  // With a pose that was found along this way, which must be short enough to tell.
  bool AgreesAfter(double way_m, const SE3& T_from_to, const Loop& loop) const;
  // Accepts waiting loops that now agree with others; true if there are any.
  bool AcceptAgreeing();
  void Correct();
  AnchorEdge OdometryEdge(std::size_t to) const;
  // Of the sensor from a submap to the one that followed, which it may have been carried to.
  double WayM(std::size_t submap) const;
  // The same to the next one that is there.
  double WayToNextM(std::size_t submap) const;
  void Trim();
  void TakeOut(const DispensableSubmap& submap);

  LoopOptions options_;
  const ByteStore* store_;
  SubmapRegistration registration_;
  std::unique_ptr<Targets> targets_;
  std::vector<Submap> submaps_;
  std::vector<Place> places_;
  std::vector<SE3> anchors_;
  bool corrected_ = false;  // before that, anchors are odometry's to the last bit
  std::vector<Loop> loops_;
  std::vector<TrimmedSubmap> trimmed_;
  double cost_before_ = 0.0, cost_ = 0.0;
};

// Adds a submap at this anchor to the selected piece of a map.
void AddToMap(const Submap& submap, const SE3& T_world_submap, VoxelMap* map);
// The same of submaps, in their order.
void AddToMap(const std::vector<Submap>& submaps, const std::vector<SE3>& anchors, VoxelMap* map);

}  // namespace lamina
