#include "tools/compare/config.h"

#include <gmock/gmock.h>

#include "config/yaml_options.h"
#include "core/base/error.h"

namespace lamina {
namespace {

const std::string kFile = std::string(LAMINA_SOURCE_DIR) + "/tools/compare/compare.yaml";

TEST(CompareConfig, TheFileHoldsTheDefaultsOfTheCode) {
  EXPECT_EQ(ToYaml(LoadCompareConfig(kFile, {})), ToYaml(CompareConfig()));
}

TEST(CompareConfig, TheFileListsEveryOptionOfTheMethods) {
  CompareConfig config;
  const std::string text = [] {
    std::ifstream file(kFile);
    return std::string(std::istreambuf_iterator<char>(file), {});
  }();
  for (const std::string& name : OptionNames([&](OptionVisitor& v) {
         v.Group("pairwise", &config.pairwise);
         v.Group("synchronisation", &config.synchronisation);
       })) {
    EXPECT_THAT(text, testing::HasSubstr(" " + name.substr(name.rfind('.') + 1) + ": ")) << name;
  }
}

TEST(CompareConfig, TakesOptionsOfTheProductAndOfTheMethodsAndNoOthers) {
  const CompareConfig config =
      LoadCompareConfig("", {"map.root_size_m=0.7", "pairwise.neighbours=9"});
  EXPECT_EQ(config.lamina.map.root_size_m, 0.7);
  EXPECT_EQ(config.pairwise.neighbours, 9);
  EXPECT_THROW(LoadCompareConfig("", {"pairwise.neighbour=9"}), OptionError);
  // Nor does the product know those of the methods.
  EXPECT_THROW(LoadConfig("", {"pairwise.neighbours=9"}), OptionError);
}

}  // namespace
}  // namespace lamina
