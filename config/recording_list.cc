#include "config/recording_list.h"

#include <fmt/format.h>
#include <glob.h>

#include <filesystem>
#include <map>

#include "config/yaml_file.h"
#include "io/file/text_input.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

class ListReader {
 public:
  explicit ListReader(const std::string& path) : path_(path) {}

  std::vector<ListedRecording> Read() {
    return UseYaml(path_, ReadFileOrPipe(path_), [&](const YAML::Node& root) {
      AddAll(root);
      if (found_.empty()) throw OptionError(fmt::format("{}: lists no recordings", path_));
      return found_;
    });
  }

 private:
  void AddAll(const YAML::Node& root) {
    if (!root.IsMap()) throw OptionError(fmt::format("{}: must have `recordings:`", path_));
    for (const auto& entry : root) {
      if (entry.first.as<std::string>() != "recordings") {
        Refuse(entry.first,
               fmt::format("unknown key `{}`; `recordings` is known", entry.first.Scalar()));
      }
      if (!entry.second.IsSequence()) Refuse(entry.first, "recordings must be a list");
      for (const YAML::Node& recording : entry.second) Add(recording);
    }
  }

  [[noreturn]] void Refuse(const YAML::Node& node, const std::string& why) const {
    throw OptionError(fmt::format("{}:{}: {}", path_, node.Mark().line + 1, why));
  }

  void Add(const YAML::Node& node) {
    ListedRecording recording;
    if (node.IsScalar()) {
      recording.scans = node.Scalar();
    } else if (node.IsMap()) {
      for (const auto& entry : node) {
        const std::string key = entry.first.Scalar();
        if (!entry.second.IsScalar()) Refuse(entry.first, fmt::format("{} must be text", key));
        Member(entry.first, key, &recording) = entry.second.Scalar();
      }
    } else {
      Refuse(node, "must be a path, or scans, name, frames and topic of a recording");
    }
    if (recording.scans.empty()) Refuse(node, "scans is missing");
    const std::vector<std::string> paths = Paths(node, recording.scans);
    if (paths.size() > 1 && !recording.name.empty())
      Refuse(node, fmt::format("name: {} recordings match; one name is not enough", paths.size()));
    for (const std::string& path : paths) {
      ListedRecording one = recording;
      one.scans = path;
      if (one.name.empty()) one.name = LastPart(path);
      Keep(node, one);
    }
  }

  std::string& Member(const YAML::Node& at, const std::string& key, ListedRecording* recording) {
    if (key == "scans") return recording->scans;
    if (key == "name") return recording->name;
    if (key == "frames") return recording->frames;
    if (key == "topic") return recording->topic;
    Refuse(at, fmt::format("unknown key `{}`; scans, name, frames and topic are known", key));
  }

  // Of a pattern, what matches, by name; a path as it is: whether it can be read shows when it is.
  std::vector<std::string> Paths(const YAML::Node& node, const std::string& scans) const {
    const std::string path =
        (fs::absolute(path_).parent_path() / scans).lexically_normal().string();
    if (scans.find_first_of("*?[") == std::string::npos || fs::exists(path)) return {path};
    std::vector<std::string> paths;
    glob_t matches = {};
    if (glob(path.c_str(), 0, nullptr, &matches) == 0)
      paths.assign(matches.gl_pathv, matches.gl_pathv + matches.gl_pathc);
    globfree(&matches);
    if (paths.empty()) Refuse(node, fmt::format("nothing matches {}", path));
    return paths;
  }

  static std::string LastPart(const std::string& path) {
    const fs::path p(path);
    return (p.has_filename() ? p : p.parent_path()).filename().string();
  }

  void Keep(const YAML::Node& node, const ListedRecording& recording) {
    const std::string& name = recording.name;
    if (name.empty() || name.front() == '.' || name.find('/') != std::string::npos)
      Refuse(node, fmt::format("name `{}`: must be the name of a folder", name));
    const auto [at, fresh] = lines_.try_emplace(name, node.Mark().line + 1);
    if (!fresh)
      Refuse(node,
             fmt::format("name `{}`: is that of line {}, too; give `name:`", name, at->second));
    found_.push_back(recording);
  }

  const std::string& path_;
  std::map<std::string, int> lines_;  // of each name
  std::vector<ListedRecording> found_;
};

}  // namespace

std::vector<ListedRecording> ReadRecordingList(const std::string& path) {
  return ListReader(path).Read();
}

}  // namespace lamina
