// What a study leaves behind: a row for each trial, and medians for each formulation and value.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "io/file/file_writer.h"
#include "tools/simulate/study.h"

namespace lamina {

// trials.csv. Rows are written as trials end, and the file takes its name in Commit().
class TrialTable {
 public:
  explicit TrialTable(const std::string& path);
  void Append(const std::vector<TrialResult>& trial);
  void Commit() { writer_.Commit(); }

 private:
  FileWriter writer_;
};

// Of all trials of a formulation at one value of a sweep: medians, but for counts and shares. A
// trial that never came to the optimum counts as infinitely slow, so the medians of iterations and
// time to the optimum are infinite if half of the trials did not.
struct TrialSummary {
  const Formulation* formulation = &CondensedFormulation();
  SweepKind sweep = SweepKind::kNoise;
  double value = 0.0;
  int trials = 0;
  double rot_error_deg = 0.0, trans_error_m = 0.0, cost = 0.0, cost_gap = 0.0;
  double iterations = 0.0, ms = 0.0;
  double fits_share = 0.0, success_share = 0.0;
  double optimum_share = 0.0;  // of trials that came within 1e-8 of the best
  double iterations_to_optimum = 0.0, ms_to_optimum = 0.0;
};

// In the order in which value and formulation first appear.
std::vector<TrialSummary> SummariseTrials(const std::vector<TrialResult>& results);

nlohmann::json SummaryJson(const StudyOptions& options, const std::vector<TrialSummary>& summaries);
// The options, and a table for each sweep, in Markdown that reads well as plain text.
std::string SummaryTables(const StudyOptions& options, const std::vector<TrialSummary>& summaries);

}  // namespace lamina
