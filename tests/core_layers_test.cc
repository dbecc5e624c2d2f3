// Folders stand in one order, and includes go down it, never up.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

namespace lamina {
namespace {

const std::map<std::string, std::vector<std::string>> kMayInclude = {
    {"core", {"core"}},
    {"io", {"core", "io"}},
    {"frontend", {"core", "frontend"}},
    {"backend", {"core", "io", "frontend", "backend"}},
    {"config", {"core", "io", "frontend", "backend", "config"}},
    {"tools", {"core", "io", "frontend", "backend", "config", "tools"}},
};

// The includes of `text`, a file of `folder`, that are not allowed there.
std::vector<std::string> WrongIncludes(const std::string& folder, const std::string& text) {
  static const std::regex kInclude(R"re(^\s*#\s*include\s*"([^"]*)")re");
  const std::vector<std::string>& allowed = kMayInclude.at(folder);
  std::vector<std::string> wrong;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::smatch match;
    if (!std::regex_search(line, match, kInclude)) continue;
    const std::string target = match[1];
    // Without a folder, or out of an unknown one such as "..", it is wrong as well.
    const std::string from = target.substr(0, target.find('/'));
    if (std::find(allowed.begin(), allowed.end(), from) == allowed.end()) wrong.push_back(target);
  }
  return wrong;
}

TEST(Layers, NoIncludeGoesUpTheOrder) {
  for (const auto& [folder, allowed] : kMayInclude) {
    int files = 0;
    const std::filesystem::path path = std::filesystem::path(LAMINA_SOURCE_DIR) / folder;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(path)) {
      const std::string extension = entry.path().extension().string();
      if (extension != ".h" && extension != ".cc") continue;
      ++files;
      std::ifstream file(entry.path());
      std::stringstream text;
      text << file.rdbuf();
      for (const std::string& target : WrongIncludes(folder, text.str())) {
        ADD_FAILURE() << entry.path() << " must not include \"" << target << "\"";
      }
    }
    EXPECT_GT(files, 1) << path;
  }
}

TEST(Layers, TheCheckCatchesWrongIncludes) {
  const std::vector<std::string> none;
  EXPECT_EQ(WrongIncludes("core", "#include <vector>\n#include \"core/se3.h\"\n"), none);
  EXPECT_EQ(WrongIncludes("backend", "#include \"frontend/odometry.h\"\n"), none);
  EXPECT_EQ(WrongIncludes("core", "int i;\n#include \"io/scan_source.h\"\n"),
            std::vector<std::string>{"io/scan_source.h"});
  EXPECT_EQ(WrongIncludes("io", "  #  include \"frontend/odometry.h\"  // no\n"),
            std::vector<std::string>{"frontend/odometry.h"});
  EXPECT_EQ(WrongIncludes("frontend", "#include \"io/scan_source.h\"\n").size(), 1U);
  EXPECT_EQ(WrongIncludes("config", "#include \"tools/run_command.h\"\n").size(), 1U);
  EXPECT_EQ(WrongIncludes("tools", "#include \"tests/random_scenes.h\"\n").size(), 1U);
  EXPECT_EQ(WrongIncludes("core", "#include \"se3.h\"\n").size(), 1U);
  EXPECT_EQ(WrongIncludes("core", "#include \"../io/scan_source.h\"\n").size(), 1U);
}

}  // namespace
}  // namespace lamina
