#include "config/config.h"

#include "config/yaml_options.h"

namespace lamina {

void LogOptions::Visit(OptionVisitor& v) {
  v.EnumChoice("level", &level, {"debug", "info", "warn", "error"});
  v.Flag("json", &json);
  v.Number("rotate_mb", &rotate_mb, 0.01, 1e5);
  v.Integer("kept_files", &kept_files, 1, 1000);
}

void LaminaConfig::VisitResultOptions(OptionVisitor& v) {
  v.Group("scans", &scans);
  v.Group("preparation", &preparation);
  v.Group("map", &map);
  v.Group("frontend", &frontend);
  v.Group("backend", &backend);
  v.Group("pipeline", &pipeline);
  v.Group("loops", &loops);
}

void LaminaConfig::Visit(OptionVisitor& v) {
  VisitResultOptions(v);
  v.Group("inbox", &inbox);
  v.Group("session", &session);
  v.Group("log", &log);
  v.Group("registration", &registration);
  v.Group("calibration", &calibration);
}

MappingOptions LaminaConfig::Mapping() const {
  return {preparation, {map, frontend, backend}, pipeline, loops};
}

void LaminaConfig::CheckTogether() const {
  preparation.CheckTogether();
  backend.CheckTogether();
}

LaminaConfig LoadConfig(const std::string& path, const std::vector<std::string>& key_values) {
  LaminaConfig config;
  ReadOptions(path, key_values, [&](OptionVisitor& v) { config.Visit(v); });
  config.CheckTogether();
  return config;
}

std::string ToYaml(LaminaConfig config) {
  return OptionsToYaml([&](OptionVisitor& v) { config.Visit(v); });
}

std::string ResultOptionsToYaml(LaminaConfig config) {
  return OptionsToYaml([&](OptionVisitor& v) { config.VisitResultOptions(v); });
}

}  // namespace lamina
