#include "backend/loops/loop_options.h"

namespace lamina {

void LoopOptions::Visit(OptionVisitor& v) {
  v.Flag("enabled", &enabled);
  v.Number("min_way_m", &min_way_m, 0.0, 1e6);
  v.Number("max_drift_percent", &max_drift_percent, 0.0, 100.0);
  v.Number("max_drift_deg_per_100m", &max_drift_deg_per_100m, 0.0, 180.0);
  v.Number("drift_sigma_percent", &drift_sigma_percent, 1e-3, 100.0);
  v.Number("drift_sigma_deg_per_100m", &drift_sigma_deg_per_100m, 1e-3, 180.0);
  v.Integer("registrations", &registrations, 1, 100);
  v.Integer("hand_over_lag_keyframes", &hand_over_lag_keyframes, 0, 1000);
  v.Integer("kept_visits", &kept_visits, 1, 1000000);
  v.Number("reach_m", &reach_m, 1.0, 10000.0);
  v.Group("submap", &submap);
  v.Group("place", &place);
  v.Group("verification", &verification);
  v.Group("graph", &graph);
  v.Group("bundle", &bundle);
}

}  // namespace lamina
