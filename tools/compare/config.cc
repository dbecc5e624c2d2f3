#include "tools/compare/config.h"

#include "config/yaml_options.h"

namespace lamina {

void CompareConfig::Visit(OptionVisitor& v) {
  lamina.Visit(v);
  v.Group("pairwise", &pairwise);
  v.Group("synchronisation", &synchronisation);
}

CompareConfig LoadCompareConfig(const std::string& path,
                                const std::vector<std::string>& key_values) {
  CompareConfig config;
  ReadOptions(path, key_values, [&](OptionVisitor& v) { config.Visit(v); });
  config.lamina.CheckTogether();
  return config;
}

std::string ToYaml(CompareConfig config) {
  return OptionsToYaml([&](OptionVisitor& v) { config.Visit(v); });
}

}  // namespace lamina
