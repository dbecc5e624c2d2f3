// Options of loop closure, all together.
#pragma once

#include "backend/anchors/anchor_graph.h"
#include "backend/places/place_image.h"
#include "backend/submaps/submap.h"
#include "backend/submaps/submap_bundle.h"
#include "backend/submaps/submap_registration.h"

namespace lamina {

struct LoopOptions {
  bool enabled = true;
  // Way of the sensor between two visits that make a loop.
  double min_way_m = 60.0;
  // What odometry may be off by, of the way along edges and accepted loops: a loop that would
  // correct more is refused, and submaps farther away are not compared.
  double max_drift_percent = 3.0;
  double max_drift_deg_per_100m = 5.0;
  // What odometry is off by as a rule: standard deviations of an edge between successive submaps.
  double drift_sigma_percent = 1.0;
  double drift_sigma_deg_per_100m = 1.0;
  // Hypotheses of each submap that are registered.
  int registrations = 4;
  // A correction takes effect so many keyframes after the submap that led to it was complete.
  int hand_over_lag_keyframes = 10;
  // Visits of a place that stay in the map beside the newest one, the first ones
  // (submap_trimming.h).
  int kept_visits = 3;
  // Once there is a correction, scans are matched to the submaps that lie this near.
  double reach_m = 100.0;
  SubmapOptions submap;
  PlaceOptions place;
  VerificationOptions verification;
  AnchorGraphOptions graph;
  SubmapBundleOptions bundle;

  void Visit(OptionVisitor& v);
};

}  // namespace lamina
