// The whole configuration of a run, YAML in and YAML out.
//
// Defaults live in the option structs alone. A YAML file names what differs; `key=value` pairs come
// after it. Keys are those of the Visit functions: `backend.window.frames` is frames below window
// below backend. An unknown key, a wrong type or a value out of range is an OptionError that names
// file, line, value and rule.
#pragma once

#include <string>
#include <vector>

#include "backend/calibration/sensor_calibration.h"
#include "backend/mapping/pipeline.h"
#include "backend/registration/batch_registration.h"
#include "backend/registration/global_synchronisation.h"
#include "backend/session/session.h"
#include "core/options/options.h"
#include "frontend/pairwise/pairwise_registration.h"
#include "io/inbox/inbox.h"

namespace lamina {

// What a daemon says of itself (`lamina watch`).
struct LogOptions {
  enum class Level { kDebug, kInfo, kWarn, kError };
  Level level = Level::kInfo;
  // Lines of JSON instead of text for people.
  bool json = false;
  // The file in the session: a new one is begun at this size, and so many old ones are kept.
  double rotate_mb = 10.0;
  int kept_files = 5;

  void Visit(OptionVisitor& v);
};

struct LaminaConfig {
  ScanSourceOptions scans;
  InboxOptions inbox;
  ScanPreparationOptions preparation;
  VoxelMapOptions map;
  OdometryOptions frontend;
  BackendOptions backend;
  PipelineOptions pipeline;
  SessionOptions session;
  LogOptions log;
  RegistrationOptions registration;
  CalibrationOptions calibration;
  PairwiseOptions pairwise;
  SynchronisationOptions synchronisation;

  void Visit(OptionVisitor& v);
  void VisitResultOptions(OptionVisitor& v);
  MappingOptions Mapping() const;
};

// Defaults, then the file (none if the path is empty), then the pairs, each checked. Where there is
// no such file, the path may be the name of a shipped one (config/shipped_configs.h). Throws
// OptionError; InputError if the file cannot be read.
LaminaConfig LoadConfig(const std::string& path, const std::vector<std::string>& key_values);

// Why there is no configuration of this name, neither as a file nor shipped.
std::string UnknownConfig(const std::string& path);

// Every option with its value, as YAML that LoadConfig reads back to the same configuration.
std::string ToYaml(const LaminaConfig& config);

// The same of the options that decide what is mapped from given scans, and nothing else.
std::string ResultOptionsToYaml(const LaminaConfig& config);

// All dotted names, in order.
std::vector<std::string> OptionNames();

}  // namespace lamina
