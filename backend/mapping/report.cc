#include "backend/mapping/report.h"

#include <string>
#include <vector>

namespace lamina {

void SolveReport::Archive(StateArchive& a) {
  a(&before_scan, &frames, &planes, &observations, &discarded, &result.status, &result.poses,
    &result.initial_cost, &result.final_cost, &result.iterations, &result.solve_ms);
}

void MappingCounts::Archive(StateArchive& a) {
  a(&scans, &frames, &keyframes, &lost, &restarts, &degenerate, &searched, &pieces, &found, &solves,
    &failed_solves, &discarded_solves);
  std::vector<SkipReason> reasons;
  std::vector<std::size_t> numbers;
  for (const auto& [reason, number] : skipped) {
    reasons.push_back(reason);
    numbers.push_back(number);
  }
  a(&reasons, &numbers);
  for (std::size_t i = 0; i < reasons.size(); ++i) skipped[reasons[i]] = numbers.at(i);
}

}  // namespace lamina
