// The methods that `lamina compare` knows, and how one of them is run on a sequence.
//
//   f2f_X        frame to frame, X of icp_point, icp_plane, gicp, ndt, vgicp
//   f2m_X        frame to map, after f2f_X            frontend/pairwise/pairwise_odometry.h
//   teaser, fgr  neighbours by a global method, chained
//   sync_teaser, sync_fgr
//                the same with more pairs, in a pose graph
//                                                     tools/compare/global_synchronisation.h
//   condensed, huang, evm2, evm1, eigen_factors, eigen_factors_lm, plane_landmarks
//                bundle adjustment                    backend/registration/batch_registration.h
//
// Methods that build on one another's work make one job: f2m_X begins with f2f_X, sync_X with X.
// Each is charged with the time of what it builds on.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "io/recording/scan_source.h"
#include "tools/compare/config.h"
#include "tools/compare/results/rows.h"

namespace lamina {

enum class CompareGroup { kFrameToFrame, kFrameToMap, kGlobal, kSynchronised, kBundle };

struct CompareMethod {
  std::string name;
  CompareGroup group;
  std::string title;   // as tables show it
  std::string source;  // authors and year
};

// In the order of the table.
const std::vector<CompareMethod>& CompareMethods();
const CompareMethod& FindMethod(const std::string& name);
std::string ToString(CompareGroup group);

// "all", or names parted by commas; a bare icp_point, icp_plane, gicp, ndt or vgicp is both of its
// forms. In the order of the table, each once. Throws OptionError naming what there is.
std::vector<std::string> ParseMethods(const std::string& text);

using CompareJob = std::vector<std::string>;  // method names
std::vector<CompareJob> GroupIntoJobs(const std::vector<std::string>& methods);

// What a job works on.
struct CompareInput {
  const ScanSource* scans = nullptr;
  std::vector<SE3> initial;  // may be empty for global methods
  CompareConfig config;
  // Bundle adjustment: scans are downsampled to this first; 0: not at all.
  double resolution_m = 0.0;
  // Of its solver; 0: those of the configuration, four times as many where steps creep (huang,
  // eigen_factors, eigen_factors_lm).
  int max_iterations = 0;
};

// Runs the job and tells of each row as it is finished. A method that fails is a row that says so.
// `progress` is called once for each scan and method. Rows have no sequence, fingerprint, memory.
void RunCompareJob(const CompareJob& job, const CompareInput& input,
                   const std::function<void()>& progress,
                   const std::function<void(CompareRow)>& on_row);

}  // namespace lamina
