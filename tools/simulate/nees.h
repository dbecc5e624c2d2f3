// Whether the covariance of an adjustment is consistent with its errors: the normalised estimation
// error squared
//
//     NEES = e' H e,     e = LocalDelta(estimate, truth), all poses but the held first
//
// with H the Gauss-Newton normal matrix of `condensed` at the estimate, planes weighted by
// 1 / noise^2, so that H^-1 is the covariance it claims. If the claim is true, NEES is chi-square
// distributed with 6 (poses - 1) degrees of freedom, and the mean of N runs lies in the interval of
// MeanNeesInterval in 95 of 100 studies (Bar-Shalom, Li, Kirubarajan: Estimation with Applications
// to Tracking and Navigation, 2001, 5.4.2).
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "tools/simulate/study.h"

namespace lamina {

struct NeesTrial {
  SweepKind sweep = SweepKind::kNoise;
  double value = 0.0;
  int trial = 0;
  std::uint64_t seed = 0;  // of the scene
  int degrees_of_freedom = 0;
  double nees = 0.0;
  PoseErrors errors;
  BundleResult::Status status = BundleResult::Status::kFailed;
};

// NEES of one scene; `trial` keeps what says where it comes from.
void MeasureNees(const SimulatedScene& scene, int max_iterations, NeesTrial* trial);

// Throws OptionError for scenes without noise: there are no errors to hold a covariance against.
void CheckNeesStudy(const StudyOptions& options);
// As RunStudy, with `condensed` alone; checks as the above.
void RunNeesStudy(const StudyOptions& options, const std::function<void(const NeesTrial&)>& sink,
                  const std::atomic<bool>* stop);

struct Interval {
  double low = 0.0, high = 0.0;
};
// What holds the mean of `runs` chi-square numbers with a probability of `share`.
Interval MeanNeesInterval(int degrees_of_freedom, int runs, double share);

struct NeesSummary {
  SweepKind sweep = SweepKind::kNoise;
  double value = 0.0;
  int degrees_of_freedom = 0, runs = 0;
  double mean = 0.0, median = 0.0, largest = 0.0;
  Interval mean_interval;    // 95 %
  double share_in_95 = 0.0;  // of the runs, in the 95 % interval of a single one
  bool consistent() const { return mean_interval.low <= mean && mean <= mean_interval.high; }
};

// In the order in which values first appear.
std::vector<NeesSummary> SummariseNees(const std::vector<NeesTrial>& trials);
std::string DescribeNees(const NeesSummary& summary);

}  // namespace lamina
