// Files, classes and members that comments and READMEs name are there, and their words are plain.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

namespace lamina {
namespace {

namespace fs = std::filesystem;

const std::vector<std::string> kFolders = {"core",   "io",    "frontend", "backend",
                                           "config", "tools", "tests"};

struct SourceTree {
  std::set<std::string> paths, names;
  std::vector<std::string> texts;  // those that are looked through
};

SourceTree ReadTree(const fs::path& root) {
  SourceTree tree;
  tree.texts.push_back("README.md");
  for (const std::string& folder : kFolders) {
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
      if (!entry.is_regular_file()) continue;
      const std::string path = entry.path().lexically_relative(root).string();
      tree.paths.insert(path);
      tree.names.insert(entry.path().filename().string());
      const std::string extension = entry.path().extension().string();
      if (extension == ".h" || extension == ".cc" || extension == ".md" || extension == ".yaml")
        tree.texts.push_back(path);
    }
  }
  return tree;
}

// What of a line is text: all of a page, and of code what follows //.
std::string TextOf(const std::string& line, bool page) {
  if (page) return line;
  const std::size_t comment = line.find("//");
  return comment == std::string::npos ? "" : line.substr(comment);
}

// Names of files in `text` that are not in the tree.
std::vector<std::string> Missing(const SourceTree& tree, const std::string& text) {
  static const std::regex kName(R"((^|[^\w/.<*])((?:\w+/)*\w+\.(?:h|cc|md|yaml))\b)");
  // Of other libraries, and of the examples of pages.
  static const std::set<std::string> kOthers = {"resolv.h", "config.yaml"};
  std::vector<std::string> missing;
  for (std::sregex_iterator i(text.begin(), text.end(), kName), end; i != end; ++i) {
    const std::string name = (*i)[2];
    const bool path = name.find('/') != std::string::npos;
    const bool known = path ? tree.paths.count(name) > 0 : tree.names.count(name) > 0;
    const bool code = name.back() == 'h' || name.back() == 'c';
    const bool ours = path ? std::find(kFolders.begin(), kFolders.end(),
                                       name.substr(0, name.find('/'))) != kFolders.end()
                           : code;
    if (ours && !known && kOthers.count(name) == 0) missing.push_back(name);
  }
  return missing;
}

// Calls visit(path, number, line, page) for each line that is looked through.
template <typename Visit>
void ForEachLine(const SourceTree& tree, const Visit& visit) {
  const fs::path root = LAMINA_SOURCE_DIR;
  for (const std::string& path : tree.texts) {
    // Names made up to be refused.
    if (path == "tests/core/names_test.cc") continue;
    const bool page = path.find(".md") != std::string::npos;
    std::ifstream file(root / path);
    int number = 0;
    for (std::string line; std::getline(file, line);) visit(path, ++number, line, page);
  }
}

TEST(Names, FilesThatTextsNameAreThere) {
  const SourceTree tree = ReadTree(LAMINA_SOURCE_DIR);
  ForEachLine(tree, [&](const std::string& path, int number, const std::string& line, bool page) {
    // A page of a folder names its files from there.
    for (const std::string& name : Missing(tree, TextOf(line, page))) {
      const fs::path beside = fs::path(path).parent_path() / name;
      if (tree.paths.count(beside.string()) == 0)
        ADD_FAILURE() << path << ":" << number << " names " << name;
    }
  });
}

// The identifiers of the code.
struct Identifiers {
  std::set<std::string> all;
  // Those of the files that declare a type, by its name.
  std::map<std::string, std::set<std::string>> beside;
};

Identifiers ReadIdentifiers(const SourceTree& tree) {
  static const std::regex kIdentifier(R"([A-Za-z_]\w*)");
  static const std::regex kDeclared(R"(\b(?:(?:class|struct)\s+(\w+)|using\s+(\w+)\s*=))");
  std::map<std::string, std::set<std::string>> of_file, declared;
  ForEachLine(tree, [&](const std::string& path, int, const std::string& line, bool page) {
    if (page || path.find(".yaml") != std::string::npos) return;
    const std::string text = line.substr(0, line.find("//"));
    for (std::sregex_iterator i(text.begin(), text.end(), kIdentifier), end; i != end; ++i)
      of_file[path].insert(i->str());
    for (std::sregex_iterator i(text.begin(), text.end(), kDeclared), end; i != end; ++i)
      declared[path].insert((*i)[1].matched ? (*i)[1] : (*i)[2]);
  });
  Identifiers found;
  for (const auto& [path, names] : of_file) {
    found.all.insert(names.begin(), names.end());
    for (const std::string& type : declared[path])
      found.beside[type].insert(names.begin(), names.end());
  }
  return found;
}

// Class::Member in `text` where the class is in no code, or no file that declares it has the
// member.
std::vector<std::string> MissingMembers(const Identifiers& code, const std::string& text) {
  static const std::regex kMember(R"(\b([A-Za-z]\w*)::(\w+))");
  std::vector<std::string> missing;
  for (std::sregex_iterator i(text.begin(), text.end(), kMember), end; i != end; ++i) {
    const auto type = code.beside.find((*i)[1]);
    // One of another library.
    const bool others = type == code.beside.end();
    const bool known = others ? code.all.count((*i)[1]) > 0 && code.all.count((*i)[2]) > 0
                              : type->second.count((*i)[2]) > 0;
    if (!known) missing.push_back(i->str());
  }
  return missing;
}

TEST(Names, MembersThatTextsNameAreThere) {
  const SourceTree tree = ReadTree(LAMINA_SOURCE_DIR);
  const Identifiers code = ReadIdentifiers(tree);
  EXPECT_EQ(MissingMembers(code, "// VoxelMap::LeafAt, std::vector"), std::vector<std::string>());
  EXPECT_EQ(MissingMembers(code, "// VoxelMap::RootsThatAreNot").size(), 1U);
  // A member of another class.
  EXPECT_EQ(MissingMembers(code, "// SE3::LeafAt").size(), 1U);
  ForEachLine(tree, [&](const std::string& path, int number, const std::string& line, bool page) {
    for (const std::string& name : MissingMembers(code, TextOf(line, page)))
      ADD_FAILURE() << path << ":" << number << " names " << name;
  });
}

// The subject of a comment is the thing in the code.
TEST(Names, CommentsSpeakOfTheCode) {
  static const std::regex kPeople(R"(\b(nobody|somebody|whoever|anybody|whisper|ghost)\b)",
                                  std::regex::icase);
  const SourceTree tree = ReadTree(LAMINA_SOURCE_DIR);
  ForEachLine(tree, [&](const std::string& path, int number, const std::string& line, bool page) {
    const std::string text = TextOf(line, page);
    std::smatch word;
    if (!page && std::regex_search(text, word, kPeople))
      ADD_FAILURE() << path << ":" << number << " has \"" << word.str() << "\"";
  });
}

TEST(Names, TheCheckCatchesWrongNames) {
  SourceTree tree;
  tree.paths = {"core/geometry/se3.h"};
  tree.names = {"se3.h"};
  using Names = std::vector<std::string>;
  EXPECT_EQ(Missing(tree, "// see core/geometry/se3.h, and se3.h"), Names());
  EXPECT_EQ(Missing(tree, "// see core/se3.h"), Names{"core/se3.h"});
  EXPECT_EQ(Missing(tree, "// (pose.h)"), Names{"pose.h"});
  EXPECT_EQ(Missing(tree, "// of <cmath> and <resolv.h>, out/config.yaml"), Names());
}

}  // namespace
}  // namespace lamina
