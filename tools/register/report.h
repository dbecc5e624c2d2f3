// What a registration tells about itself: rounds.csv while it goes on, then covariance.csv and
// summary.json.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "backend/registration/batch_registration.h"
#include "io/file/file_writer.h"
#include "tools/metrics/trajectory_metrics.h"

namespace lamina {

// A line for each step of each round.
class RoundTable {
 public:
  explicit RoundTable(const std::string& path);
  void Append(const RoundReport& round, const BundleStep& step);
  void Commit() { writer_.Commit(); }

 private:
  FileWriter writer_;
};

// A line for each frame: the upper triangle of its pose's covariance, tangent [rotation;
// translation] of core/geometry/se3.h (rad^2, rad m, m^2).
void WriteCovariances(const std::string& path, const std::vector<std::size_t>& scans,
                      const std::vector<Matrix6d>& covariances);

struct RegistrationFigures {
  double read_s = 0.0, wall_s = 0.0, cpu_s = 0.0;
  std::size_t scans = 0, skipped = 0, map_surfels = 0;
};

// Frames in messages are scans of the recording, by `scans`. `errors` is null without a truth.
nlohmann::json Summarise(const RegistrationResult& result, const std::vector<std::size_t>& scans,
                         const std::string& formulation, const RegistrationFigures& figures,
                         const TrajectoryErrors* errors);

}  // namespace lamina
