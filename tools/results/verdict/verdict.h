// Whether the poses of a run can be believed, in one word with reasons.
// What is measured, and what is too much of it: tools/results/verdict/rules.h.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "io/store/scan_record.h"

namespace lamina {

struct RunVerdict {
  enum class Grade { kGood = 0, kDoubtful = 1, kWrong = 2 };
  Grade grade = Grade::kGood;
  std::vector<std::string> reasons;  // of the grade; empty if it is good
  std::string hint;                  // what to try; empty if it is good
};

// Exit code of a command that ended in order with poses that are probably wrong.
inline constexpr int kProbablyWrong = 3;

std::string ToString(RunVerdict::Grade grade);
// One line: "doubtful: 12 % of the scans are lost (5 % are too many). Try ...".
std::string ToString(const RunVerdict& verdict);
// Of summary.json: verdict, reasons, hint.
nlohmann::json ToJson(const RunVerdict& verdict);
// The "verdict" of a summary.json; nothing if it has none that is whole.
std::optional<RunVerdict> ReadVerdict(const nlohmann::json& summary);

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
  void Add(const ScanRecord& scan);
  // A piece that was found to be connected to another one.
  void Join(std::int64_t piece) { pieces_.erase(piece); }
  RunVerdict Judge() const;

 private:
  void CountPiece(const ScanRecord& scan);
  void CountJump(const ScanRecord& scan);

  int max_iterations_;
  std::int64_t frames_ = 0, skipped_ = 0, lost_ = 0, degenerate_ = 0;
  std::int64_t matched_ = 0, unconverged_ = 0;
  std::int64_t motions_ = 0, jumps_ = 0;
  ShareHistogram inliers_, fits_;
  std::set<std::int64_t> pieces_;
  std::map<std::string, std::int64_t> piece_of_;  // the newest of each recording
  std::int64_t last_piece_ = 0;
  std::deque<StampedPose> last_;  // at most two of that piece, that follow one another
};

}  // namespace lamina
