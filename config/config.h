// The configuration of all commands that map, watch, register or calibrate, YAML in and YAML out
// (config/yaml_options.h).
#pragma once

#include <string>
#include <vector>

#include "backend/calibration/sensor_calibration.h"
#include "backend/loops/loop_options.h"
#include "backend/mapping/options.h"
#include "backend/registration/batch_registration.h"
#include "backend/session/options.h"
#include "core/options/options.h"
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
  LoopOptions loops;
  SessionOptions session;
  LogOptions log;
  RegistrationOptions registration;
  CalibrationOptions calibration;

  void Visit(OptionVisitor& v);
  void VisitResultOptions(OptionVisitor& v);
  MappingOptions Mapping() const;
  // Throws OptionError for options that contradict one another.
  void CheckTogether() const;
};

// ReadOptions of all of it; throws OptionError as well for options that contradict one another.
LaminaConfig LoadConfig(const std::string& path, const std::vector<std::string>& key_values);

// Every option with its value, as YAML that LoadConfig reads back to the same configuration.
std::string ToYaml(LaminaConfig config);

// The same of the options that decide what is mapped from given scans, and nothing else.
std::string ResultOptionsToYaml(LaminaConfig config);

}  // namespace lamina
