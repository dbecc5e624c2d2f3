// Whether the poses of a run can be believed, in one word with reasons.
//
// The measures are absolute, never compared with the run's own median: a sensor that was lost from
// the first scan on is steadily so. The thickness of the map is none of them: a run that is stuck
// in one place has the thinnest map.
//
//   measure                                                        doubtful      wrong
//   ------------------------------------------------------------------------------------
//   matches that did not converge, of those matched                    8 %       15 %
//   median share of inliers                                           0.30       0.20
//   median fit of what meets planes at all                            0.75       0.60
//   frames that are lost                                               5 %       50 %
//   motions that no vehicle makes: more than 30 m/s^2                  1 %        4 %
//   frames with a direction that nothing determines                   25 %        -
//   pieces that no match connects                                        2        -
//
// Seen in generated scenes with exact truth (lamina adverse): runs that are right have up to 3 %
// that do not converge, 0.39 of inliers or more, a fit of 0.86 or more, and 1 % of such motions;
// runs that slip have 4 to 25 % of them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <nlohmann/json_fwd.hpp>
#include <set>
#include <string>
#include <vector>

#include "io/session_database.h"

namespace lamina {

struct RunVerdict {
  enum class Grade { kGood, kDoubtful, kWrong };
  Grade grade = Grade::kGood;
  std::vector<std::string> reasons;  // of the grade; empty if it is good
  std::string hint;                  // what to try; empty if it is good
};

std::string ToString(RunVerdict::Grade grade);
// One line: "doubtful: 12 % of the scans are lost (5 % are too many). Try ...".
std::string ToString(const RunVerdict& verdict);
// Of summary.json: verdict, reasons, hint.
nlohmann::json ToJson(const RunVerdict& verdict);

// Counts of numbers in [0, 1], to the thousandth: a run may have any number of scans.
class ShareHistogram {
 public:
  void Add(double share);
  bool empty() const { return all_ == 0; }
  double Median() const;  // there must be one at least

 private:
  std::array<std::int64_t, 1001> counts_{};
  std::int64_t all_ = 0;
};

// Not thread-safe.
class VerdictCounter {
 public:
  // max_iterations: of the matcher, at which a match has not converged.
  explicit VerdictCounter(int max_iterations) : max_iterations_(max_iterations) {}

  // Scans in order, those that were skipped too.
  void Add(const SessionScan& scan);
  RunVerdict Judge() const;

 private:
  void CountJump(const SessionScan& scan);

  int max_iterations_;
  std::int64_t frames_ = 0, lost_ = 0, degenerate_ = 0;
  std::int64_t matched_ = 0, unconverged_ = 0;
  std::int64_t motions_ = 0, jumps_ = 0;
  ShareHistogram inliers_, fits_;
  std::set<std::int64_t> pieces_;
  struct Pose {
    std::int64_t piece = 0;
    StampNs stamp_ns = 0;
    SE3 T_world_lidar;
  };
  std::deque<Pose> last_;  // at most two, that follow one another
};

}  // namespace lamina
