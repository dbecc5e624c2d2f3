// What a method achieved on a sequence, and how it is kept from one call to the next.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/se3.h"

namespace lamina {

// Distances of a method's map to the true surfaces (paper IV-B2), metres.
struct StructuralError {
  std::size_t points = 0;
  double mean_m = 0.0, median_m = 0.0, percentile90_m = 0.0;
  double within_5cm = 0.0;  // share
  std::vector<double>
      distribution;  // shares in steps of 1 mm from 0; the last is all that is beyond
};

struct CompareRow {
  std::string sequence, method;
  // Of all that the result depends on: rows of another fingerprint are not reused.
  std::string fingerprint;
  bool good = false;
  std::string reason;         // of a failure
  double time_limit_s = 0.0;  // that it ran into; 0: it did not
  std::vector<SE3> poses;     // T_world_scan, one for each scan
  double wall_s = 0.0;        // one thread, without reading files
  double cpu_s = 0.0;
  std::size_t peak_rss_bytes = 0;  // of the process
  // Bundle adjustment alone.
  double solve_s = 0.0;
  int rounds = 0, iterations = 0;
  std::size_t planes = 0;
  std::optional<StructuralError> structure;
};

nlohmann::json ToJson(const CompareRow& row);
// Throws nlohmann::json::exception.
CompareRow RowFromJson(const nlohmann::json& json);

// Whole or not there. Throws OutputError.
void WriteRow(const std::string& path, const CompareRow& row);
// Nothing if there is no such file, or it cannot be understood, or has another fingerprint.
std::optional<CompareRow> ReadRow(const std::string& path, const std::string& fingerprint);

// A short name for a long text (FNV-1a, 64 bits).
std::string Fingerprint(const std::string& text);

}  // namespace lamina
