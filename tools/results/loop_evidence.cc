#include "tools/results/loop_evidence.h"

#include <fmt/format.h>

namespace lamina {

std::string LoopEvidence(const SubmapMatch& match) {
  const SE3& T = match.T_other_query;
  return fmt::format(
      "{},{:.4f},{:.4f},{:.4f},{:.3f},{:.4f},{},{:.6f},{:.6f},{:.6f},{:.9f},{:.9f},{:.9f},{:.9f}",
      match.planes, match.overlap, match.structure, match.residual_sigmas, match.facing, match.gone,
      match.looks, T.t.x(), T.t.y(), T.t.z(), T.q.x(), T.q.y(), T.q.z(), T.q.w());
}

}  // namespace lamina
