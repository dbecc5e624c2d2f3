// Task files: what a comparison and its jobs say to one another. Private to both.
#pragma once

#include <nlohmann/json.hpp>

#include "tools/compare/jobs/jobs.h"

namespace lamina {

// The pipe for steps, in the job.
inline constexpr int kProgressFd = 3;
// The hidden option that names the task file.
inline constexpr const char* kWorkerOption = "--worker";

inline nlohmann::json TaskToJson(const CompareTask& task) {
  return {{"methods", task.methods},           {"sequence", task.sequence},
          {"fingerprint", task.fingerprint},   {"scans", task.scans},
          {"initial", task.initial},           {"config", task.config},
          {"resolution_m", task.resolution_m}, {"max_iterations", task.max_iterations},
          {"row_folder", task.row_folder},     {"time_limit_s", task.time_limit_s}};
}

inline CompareTask TaskFromJson(const nlohmann::json& json) {
  CompareTask task;
  json.at("methods").get_to(task.methods);
  json.at("sequence").get_to(task.sequence);
  json.at("fingerprint").get_to(task.fingerprint);
  json.at("scans").get_to(task.scans);
  json.at("initial").get_to(task.initial);
  json.at("config").get_to(task.config);
  json.at("resolution_m").get_to(task.resolution_m);
  json.at("max_iterations").get_to(task.max_iterations);
  json.at("row_folder").get_to(task.row_folder);
  json.at("time_limit_s").get_to(task.time_limit_s);
  return task;
}

}  // namespace lamina
