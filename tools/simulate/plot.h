// The picture of a study, after figure 1 of Huang et al., RA-L 2021: a column for each sweep;
// above, the error of the poses, below, the time of a solve; a curve for each formulation, through
// the medians.
#pragma once

#include <string>
#include <vector>

#include "tools/simulate/report.h"

namespace lamina {

// The script that DrawStudy pipes to gnuplot; the picture goes to `output_path`.
std::string StudyScript(const std::vector<TrialSummary>& summaries, const std::string& output_path);

// Draws `stem`.png, or `stem`.svg if this gnuplot cannot do the former. Returns the path; throws
// OutputError if neither can be drawn.
std::string DrawStudy(const std::vector<TrialSummary>& summaries, const std::string& stem);

}  // namespace lamina
