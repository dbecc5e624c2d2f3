// The tables of a comparison: who was how far off, where.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "tools/compare/results/rows.h"
#include "tools/metrics/trajectory_metrics.h"

namespace lamina {

struct CompareCell {
  CompareRow row;
  TrajectoryErrors errors;  // SE(3)-aligned; of good rows alone
};

struct CompareColumn {
  std::string sequence;
  std::size_t scans = 0;
  TrajectoryErrors initial;  // of the initial poses
  bool has_initial = false;
  std::map<std::string, CompareCell> cells;  // by method
};

// Errors of poses against a truth of the same length.
TrajectoryErrors CompareAll(const std::vector<SE3>& poses, const std::vector<SE3>& truth);

struct CompareTable {
  std::string title;                 // says what the data are
  std::vector<std::string> methods;  // in the order of the table
  std::vector<CompareColumn> columns;
};

// RPE and APE (RMSE, cm) of each method on each sequence and in the mean, best bold, second best
// underlined, as Table I of the paper prints them; then rotation, time, memory, structural error;
// then what failed, and why. A mean is over all sequences, or there is none.
std::string MarkdownTable(const CompareTable& table);
// A line for each method and sequence; empty fields where it failed.
std::string CsvTable(const CompareTable& table);
nlohmann::json JsonTable(const CompareTable& table);

}  // namespace lamina
