// The configurations that come with the program (config/*.yaml). They are part of it, so that it
// finds them by name wherever it is installed or copied to.
#pragma once

#include <string>
#include <vector>

namespace lamina {

struct ShippedConfig {
  std::string name;  // of the file, without its ending
  std::string text;  // as the file stands
};

// In the order of their names.
const std::vector<ShippedConfig>& ShippedConfigs();

// By its name, with or without .yaml; null if there is none.
const ShippedConfig* FindShippedConfig(const std::string& name);

// What it is for: the comment that it begins with, on one line.
std::string PurposeOf(const ShippedConfig& config);

}  // namespace lamina
