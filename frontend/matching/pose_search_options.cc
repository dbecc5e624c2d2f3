#include "frontend/matching/pose_search_options.h"

namespace lamina {

void PoseSearchOptions::Visit(OptionVisitor& v) {
  v.Flag("enabled", &enabled);
  v.Number("trigger_rotation_deg", &trigger_rotation_deg, 0.0, 180.0);
  v.Number("trigger_translation_m", &trigger_translation_m, 0.0, 1e3);
  v.Number("trigger_inlier_ratio", &trigger_inlier_ratio, 0.0, 10.0);
  v.Number("range_deg", &range_deg, 0.0, 60.0);
  v.Number("step_deg", &step_deg, 0.5, 60.0);
  v.Number("range_m", &range_m, 0.0, 20.0);
  v.Number("step_m", &step_m, 0.05, 20.0);
  v.Number("max_way_m", &max_way_m, 0.0, 200.0);
  v.Integer("clusters", &clusters, 10, 100000);
  v.Number("score_scale_m", &score_scale_m, 0.001, 10.0);
  v.Integer("refined", &refined, 1, 1000);
}

}  // namespace lamina
