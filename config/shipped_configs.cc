#include "config/shipped_configs.h"

#include <algorithm>
#include <sstream>

namespace lamina {

const ShippedConfig* FindShippedConfig(const std::string& name) {
  const auto& all = ShippedConfigs();
  const auto found = std::find_if(all.begin(), all.end(), [&](const ShippedConfig& config) {
    return name == config.name || name == config.name + ".yaml";
  });
  return found == all.end() ? nullptr : &*found;
}

std::string PurposeOf(const ShippedConfig& config) {
  std::istringstream lines(config.text);
  std::string purpose;
  for (std::string line; std::getline(lines, line) && line.rfind("# ", 0) == 0;) {
    purpose += (purpose.empty() ? "" : " ") + line.substr(2);
  }
  return purpose;
}

}  // namespace lamina
