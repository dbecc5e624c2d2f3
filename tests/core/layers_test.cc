// Folders stand in one order, and includes go down it, never up.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
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

// Rooms inside a folder, the lowest first, where they stand in one order: a file includes from its
// own room and from lower ones. A room of several names is one step: its rooms do not include from
// one another.
const std::map<std::string, std::vector<std::vector<std::string>>> kRooms = {
    {"core", {{"core/base"}, {"core/geometry"}, {"core/options"}, {"core/map"}}},
    {"io",
     {{"io/file"},
      {"io/las", "io/stream", "io/store"},
      {"io/container"},
      {"io/points", "io/packet"},
      {"io/map", "io/message"},
      {"io/recording"},
      {"io/inbox"}}},
    {"frontend",
     {{"frontend/scan"},
      {"frontend/matching"},
      {"frontend/odometry"},
      {"frontend/start", "frontend/pairwise"}}},
    {"backend",
     {{"backend/bundle"},
      {"backend/bundle/solver"},
      {"backend/bundle/uncertainty"},
      {"backend/anchors"},
      {"backend/submaps"},
      {"backend/places"},
      {"backend/loops"},
      {"backend/localisation"},
      {"backend/window"},
      {"backend/pieces"},
      {"backend/bundle/formulations", "backend/mapping"},
      {"backend/opening"},
      {"backend/registration", "backend/calibration", "backend/session"},
      {"backend/tiles"}}},
};

std::string RoomOf(const std::string& file) { return file.substr(0, file.rfind('/')); }

// The steps of a folder's rooms that a file in `room` may include from; -1: it is in none of them.
int StepOf(const std::string& folder, const std::string& room) {
  const auto& steps = kRooms.at(folder);
  for (std::size_t i = 0; i < steps.size(); ++i) {
    if (std::find(steps[i].begin(), steps[i].end(), room) != steps[i].end())
      return static_cast<int>(i);
  }
  return -1;
}

bool MayIncludeInside(const std::string& folder, const std::string& room,
                      const std::string& target) {
  if (target == room) return true;
  const int from = StepOf(folder, room), to = StepOf(folder, target);
  return from < 0 || (to >= 0 && to < from);
}

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

TEST(Layers, NoIncludeGoesUpTheRoomsOfAFolder) {
  static const std::regex kInclude(R"re(^\s*#\s*include\s*"([^"]*)")re");
  const std::filesystem::path root = LAMINA_SOURCE_DIR;
  for (const auto& [folder, rooms] : kRooms) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(root / folder)) {
      const std::string file = entry.path().lexically_relative(root).string();
      const std::string extension = entry.path().extension().string();
      if (extension != ".h" && extension != ".cc") continue;
      std::ifstream lines(entry.path());
      for (std::string line; std::getline(lines, line);) {
        std::smatch match;
        if (!std::regex_search(line, match, kInclude)) continue;
        const std::string target = match[1];
        if (target.substr(0, target.find('/')) != folder) continue;
        EXPECT_TRUE(MayIncludeInside(folder, RoomOf(file), RoomOf(target)))
            << file << " must not include \"" << target << "\"";
      }
    }
  }
}

// About twenty files: a folder of more has several subjects, and comes apart along them.
TEST(Layers, FoldersAreSmall) {
  constexpr int kMostFiles = 24;
  const std::filesystem::path root = LAMINA_SOURCE_DIR;
  std::map<std::string, int> files;
  for (const char* folder : {"core", "io", "frontend", "backend", "config", "tools", "tests"}) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(root / folder)) {
      const std::string extension = entry.path().extension().string();
      if (extension == ".h" || extension == ".cc")
        ++files[entry.path().parent_path().lexically_relative(root).string()];
    }
  }
  EXPECT_GT(files.size(), 50U);
  for (const auto& [folder, count] : files) EXPECT_LE(count, kMostFiles) << folder;
}

TEST(Layers, EveryFileHasARoom) {
  for (const auto& [folder, rooms] : kRooms) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(
             std::filesystem::path(LAMINA_SOURCE_DIR) / folder)) {
      if (entry.path().extension() != ".h") continue;
      const std::string room = RoomOf(entry.path().lexically_relative(LAMINA_SOURCE_DIR).string());
      EXPECT_GE(StepOf(folder, room), 0) << entry.path();
    }
  }
}

// A header is private to its room if it says so at its head; what is used by that room alone has
// to.
struct Header {
  std::string room;
  bool is_private = false;
  std::set<std::string> includers;  // in the tree, but for tests
};

std::map<std::string, Header> Headers() {
  static const std::regex kInclude(R"re(^\s*#\s*include\s*"([^"]*)")re");
  const std::filesystem::path root = LAMINA_SOURCE_DIR;
  std::map<std::string, Header> headers;
  std::map<std::string, std::vector<std::string>> includes;  // of each file
  for (const auto& [folder, allowed] : kMayInclude) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(root / folder)) {
      const std::string file = entry.path().lexically_relative(root).string();
      const std::string extension = entry.path().extension().string();
      if (extension != ".h" && extension != ".cc") continue;
      std::ifstream lines(entry.path());
      bool head = true;
      for (std::string line; std::getline(lines, line);) {
        std::smatch match;
        head = head && line.rfind("//", 0) == 0;
        if (head && extension == ".h" && kRooms.count(folder) > 0) {
          Header& header = headers[file];
          header.room = RoomOf(file);
          header.is_private |= line == "// Private to " + header.room + ".";
        }
        if (std::regex_search(line, match, kInclude)) includes[file].push_back(match[1]);
      }
    }
  }
  for (const auto& [file, targets] : includes) {
    for (const std::string& target : targets) {
      const auto header = headers.find(target);
      if (header != headers.end()) header->second.includers.insert(file);
    }
  }
  return headers;
}

TEST(Layers, WhatOneRoomUsesAloneIsMarkedPrivateAndStaysSo) {
  const std::map<std::string, Header> headers = Headers();
  int found = 0;
  for (const auto& [name, header] : headers) {
    // What a public header includes is not private.
    const bool used_here_alone =
        !header.includers.empty() &&
        std::all_of(header.includers.begin(), header.includers.end(), [&](const std::string& file) {
          const auto other = headers.find(file);
          return RoomOf(file) == header.room &&
                 (other == headers.end() || other->second.is_private);
        });
    EXPECT_EQ(header.is_private, used_here_alone)
        << name << (header.is_private ? " is private to " : " should say: Private to ")
        << header.room;
    found += header.is_private ? 1 : 0;
  }
  EXPECT_GT(found, 20);
}

TEST(Layers, TheCheckCatchesWrongRooms) {
  EXPECT_TRUE(MayIncludeInside("core", "core/map", "core/base"));
  EXPECT_FALSE(MayIncludeInside("core", "core/base", "core/map"));
  EXPECT_FALSE(MayIncludeInside("backend", "backend/session", "backend/calibration"));
  EXPECT_FALSE(MayIncludeInside("backend", "backend/mapping", "backend/bundle/formulations"));
  EXPECT_TRUE(MayIncludeInside("backend", "backend/bundle/formulations", "backend/bundle"));
}

TEST(Layers, TheCheckCatchesWrongIncludes) {
  const std::vector<std::string> none;
  EXPECT_EQ(WrongIncludes("core", "#include <vector>\n#include \"core/geometry/se3.h\"\n"), none);
  EXPECT_EQ(WrongIncludes("backend", "#include \"frontend/odometry/odometry.h\"\n"), none);
  EXPECT_EQ(WrongIncludes("core", "int i;\n#include \"io/recording/scan_source.h\"\n"),
            std::vector<std::string>{"io/recording/scan_source.h"});
  EXPECT_EQ(WrongIncludes("io", "  #  include \"frontend/odometry/odometry.h\"  // no\n"),
            std::vector<std::string>{"frontend/odometry/odometry.h"});
  EXPECT_EQ(WrongIncludes("frontend", "#include \"io/recording/scan_source.h\"\n").size(), 1U);
  EXPECT_EQ(WrongIncludes("config", "#include \"tools/run/command.h\"\n").size(), 1U);
  EXPECT_EQ(WrongIncludes("tools", "#include \"tests/support/scenes/random_scenes.h\"\n").size(),
            1U);
  EXPECT_EQ(WrongIncludes("core", "#include \"se3.h\"\n").size(), 1U);
  EXPECT_EQ(WrongIncludes("core", "#include \"../io/scan_source.h\"\n").size(), 1U);
}

}  // namespace
}  // namespace lamina
