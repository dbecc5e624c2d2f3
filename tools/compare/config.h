// The configuration of `lamina compare`: what the product has, and what the published methods are
// run with (compare.yaml).
#pragma once

#include <string>
#include <vector>

#include "config/config.h"
#include "frontend/pairwise/pairwise_registration.h"
#include "tools/compare/global_synchronisation.h"

namespace lamina {

struct CompareConfig {
  LaminaConfig lamina;
  PairwiseOptions pairwise;
  SynchronisationOptions synchronisation;

  void Visit(OptionVisitor& v);
};

// As LoadConfig and ToYaml of config/config.h.
CompareConfig LoadCompareConfig(const std::string& path,
                                const std::vector<std::string>& key_values);
std::string ToYaml(CompareConfig config);

}  // namespace lamina
