#include "config/yaml_options.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <set>
#include <string_view>
#include <type_traits>

#include "config/shipped_configs.h"
#include "config/yaml_file.h"
#include "core/geometry/se3.h"
#include "core/options/nearest_name.h"
#include "io/file/text_input.h"

namespace lamina {
namespace {

std::string JoinNames(const std::vector<std::string>& names) {
  std::string joined;
  for (const std::string& name : names) joined += (joined.empty() ? "" : ", ") + name;
  return joined;
}

struct Setting {
  std::string value;
  std::string place;  // file:line, or the pair as given
  bool list = false;
};

using Settings = std::map<std::string, Setting>;

// The numbers of a list, or of a list of rows.
std::vector<double> NumbersOf(const YAML::Node& node) {
  if (node.IsScalar()) return {node.as<double>()};
  std::vector<double> numbers;
  for (const YAML::Node& part : node) {
    const std::vector<double> more = NumbersOf(part);
    numbers.insert(numbers.end(), more.begin(), more.end());
  }
  return numbers;
}

// From x y z qx qy qz qw, or the 3x4 or 4x4 numbers of a matrix, row by row.
SE3 PoseFromNumbers(const std::vector<double>& v) {
  constexpr double kTolerance = 1e-3;
  if (v.size() == 7) {
    SE3 pose;
    pose.t = {v[0], v[1], v[2]};
    pose.q = Eigen::Quaterniond(v[6], v[3], v[4], v[5]);
    const double norm = pose.q.norm();
    if (!(std::abs(norm - 1.0) <= kTolerance)) {
      throw OptionError(fmt::format("its quaternion must have length 1, not {:.6g}", norm));
    }
    // What has been written by ToYaml stays as it is, to the last bit.
    if (std::abs(norm - 1.0) > 1e-12) pose.q.normalize();
    return pose;
  }
  if (v.size() != 12 && v.size() != 16) {
    throw OptionError(fmt::format(
        "must be 7 numbers, x y z qx qy qz qw, or the 12 or 16 of a matrix, not {}", v.size()));
  }
  const Eigen::Matrix<double, 3, 4> T =
      Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>>(v.data());
  const Eigen::Matrix3d R = T.leftCols<3>();
  const double off = (R * R.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  if (!(off <= kTolerance) || R.determinant() < 0.0) {
    throw OptionError(fmt::format(
        "its 3x3 part must be a rotation: R R^T is off the identity by {:.6g}, its determinant is "
        "{:.6g}",
        off, R.determinant()));
  }
  if (v.size() == 16 && !(v[12] == 0.0 && v[13] == 0.0 && v[14] == 0.0 && v[15] == 1.0)) {
    throw OptionError("its last row must be 0 0 0 1");
  }
  return SE3(R, T.col(3));
}

// 010 would be read as eight.
bool HasLeadingZero(std::string_view number) {
  number.remove_prefix(std::min(number.find_first_not_of("+-"), number.size()));
  return number.size() > 1 && number[0] == '0';
}

// Gives options the values of `settings`, and remembers which names there are.
class Assigner final : public NamedOptionVisitor {
 public:
  explicit Assigner(const Settings& settings) : settings_(settings) {}

  void Number(const char* name, double* value, double low, double high) override {
    Assign(name, "a number", value,
           [&] { OptionChecker("").Number(FullName(name).c_str(), value, low, high); });
  }
  void Integer(const char* name, int* value, int low, int high) override {
    Assign(name, "a whole number, without leading zeros", value,
           [&] { OptionChecker("").Integer(FullName(name).c_str(), value, low, high); });
  }
  void Flag(const char* name, bool* value) override {
    Assign(name, "true or false", value, [] {});
  }
  void Choice(const char* name, int* index, const std::vector<std::string>& names) override {
    const Setting* setting = Find(name);
    if (setting == nullptr) return;
    const auto found = std::find(names.begin(), names.end(), setting->value);
    if (found == names.end()) {
      throw OptionError(fmt::format("{}: {} = {}: must be one of {}", setting->place,
                                    FullName(name), setting->value, JoinNames(names)));
    }
    *index = static_cast<int>(found - names.begin());
  }
  void Text(const char* name, std::string* value, std::size_t most_bytes) override {
    const Setting* setting = Find(name);
    if (setting == nullptr) return;
    *value = setting->value;
    InPlace(*setting, [&] { OptionChecker("").Text(FullName(name).c_str(), value, most_bytes); });
  }

  void NumberRows(const char* name, std::vector<std::vector<double>>* rows,
                  const std::vector<OptionColumn>& columns, std::size_t most) override {
    const Setting* setting = FindAny(name);
    if (setting == nullptr) return;
    try {
      *rows = YAML::Load(setting->value).as<std::vector<std::vector<double>>>();
    } catch (const YAML::Exception&) {
      throw OptionError(fmt::format("{}: {} = {}: must be a list of rows, each a list of numbers",
                                    setting->place, FullName(name), setting->value));
    }
    InPlace(*setting,
            [&] { OptionChecker("").NumberRows(FullName(name).c_str(), rows, columns, most); });
  }
  void FolderPoses(const char* name, std::map<std::string, SE3>* poses, double most_m) override {
    const Setting* whole = Find(name);
    if (whole != nullptr && whole->value != "{}") {
      throw OptionError(
          fmt::format("{}: {} = {}: must be a group, a pose for each folder: {}.FOLDER",
                      whole->place, FullName(name), whole->value, FullName(name)));
    }
    const std::string prefix = FullName(name) + ".";
    for (auto it = settings_.lower_bound(prefix);
         it != settings_.end() && it->first.compare(0, prefix.size(), prefix) == 0; ++it) {
      const auto& [full_name, setting] = *it;
      names_.push_back(full_name);
      const std::string folder = full_name.substr(prefix.size());
      (*poses)[folder] = PoseOf(full_name, setting);
      std::map<std::string, SE3> one{{folder, (*poses)[folder]}};
      InPlace(setting,
              [&] { OptionChecker("").FolderPoses(FullName(name).c_str(), &one, most_m); });
    }
  }

  const std::vector<std::string>& names() const { return names_; }

 private:
  const Setting* FindAny(const char* name) {
    names_.push_back(FullName(name));
    const auto found = settings_.find(names_.back());
    return found == settings_.end() ? nullptr : &found->second;
  }
  const Setting* Find(const char* name) {
    const Setting* setting = FindAny(name);
    if (setting != nullptr && setting->list) {
      throw OptionError(
          fmt::format("{}: '{}' must be a single value or a group", setting->place, names_.back()));
    }
    return setting;
  }

  static SE3 PoseOf(const std::string& name, const Setting& setting) {
    try {
      return PoseFromNumbers(NumbersOf(YAML::Load(setting.value)));
    } catch (const YAML::Exception&) {
    } catch (const OptionError& error) {
      throw OptionError(
          fmt::format("{}: {} = {}: {}", setting.place, name, setting.value, error.what()));
    }
    throw OptionError(
        fmt::format("{}: {} = {}: must be a list of numbers", setting.place, name, setting.value));
  }

  template <typename Check>
  static void InPlace(const Setting& setting, const Check& check) {
    try {
      check();
    } catch (const OptionError& error) {
      throw OptionError(fmt::format("{}: {}", setting.place, error.what()));
    }
  }

  template <typename T, typename Check>
  void Assign(const char* name, const char* rule, T* value, const Check& check) {
    const Setting* setting = Find(name);
    if (setting == nullptr) return;
    try {
      const YAML::Node node = YAML::Load(setting->value);
      if (std::is_same_v<T, int> && HasLeadingZero(setting->value)) throw YAML::BadConversion({});
      *value = node.as<T>();
    } catch (const YAML::Exception&) {
      throw OptionError(fmt::format("{}: {} = {}: must be {}", setting->place, FullName(name),
                                    setting->value, rule));
    }
    InPlace(*setting, check);
  }

  const Settings& settings_;
  std::vector<std::string> names_;
};

// A name that is right but for its section is more often meant than one that looks alike.
const std::string& MeantOption(const std::string& name, const std::vector<std::string>& names) {
  const std::string last = name.substr(name.rfind('.') + 1);
  const auto elsewhere = std::find_if(names.begin(), names.end(), [&](const std::string& other) {
    return other.substr(other.rfind('.') + 1) == last;
  });
  return elsewhere != names.end() ? *elsewhere : NearestName(name, names);
}

void RefuseUnknown(const Settings& settings, const std::vector<std::string>& names) {
  const std::set<std::string> known(names.begin(), names.end());
  for (const auto& [name, setting] : settings) {
    if (known.count(name) > 0) continue;
    throw OptionError(fmt::format("{}: unknown option '{}'; did you mean '{}'?", setting.place,
                                  name, MeantOption(name, names)));
  }
}

void Flatten(const YAML::Node& node, const std::string& prefix, const std::string& file,
             Settings* settings) {
  for (const auto& entry : node) {
    const auto key = entry.first.as<std::string>();
    const std::string name = prefix.empty() ? key : prefix + "." + key;
    const std::string place = fmt::format("{}:{}", file, entry.first.Mark().line + 1);
    if (entry.second.IsMap()) {
      Flatten(entry.second, name, file, settings);
    } else if (entry.second.IsScalar() || entry.second.IsSequence()) {
      YAML::Emitter list;
      list << YAML::Flow << entry.second;
      const bool scalar = entry.second.IsScalar();
      const Setting setting{scalar ? entry.second.Scalar() : list.c_str(), place, !scalar};
      if (!settings->emplace(name, setting).second) {
        throw OptionError(fmt::format("{}: option '{}' is given twice", place, name));
      }
    } else {
      throw OptionError(fmt::format("{}: '{}' must be a single value or a group", place, name));
    }
  }
}

// Of the file, or else of the shipped configuration of that name.
std::string TextOf(const std::string& path) {
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) {
    if (const ShippedConfig* const shipped = FindShippedConfig(path)) return shipped->text;
    throw InputError(UnknownConfig(path));
  }
  return ReadFileOrPipe(path);
}

Settings ReadYaml(const std::string& path) {
  return UseYaml(path, TextOf(path), [&](const YAML::Node& root) {
    Settings settings;
    if (root.IsNull()) return settings;
    if (!root.IsMap()) throw OptionError(fmt::format("{}:1: must be a map of options", path));
    Flatten(root, "", path, &settings);
    return settings;
  });
}

// The options as YAML text.
class Emitter final : public OptionVisitor {
 public:
  void Number(const char* name, double* value, double, double) override {
    Line(name, fmt::format("{}", *value));
  }
  void Integer(const char* name, int* value, int, int) override {
    Line(name, std::to_string(*value));
  }
  void Flag(const char* name, bool* value) override { Line(name, *value ? "true" : "false"); }
  void Choice(const char* name, int* index, const std::vector<std::string>& names) override {
    Line(name, names.at(static_cast<std::size_t>(*index)));
  }
  void Text(const char* name, std::string* value, std::size_t) override {
    YAML::Emitter quoted;
    quoted << YAML::DoubleQuoted << *value;
    Line(name, quoted.c_str());
  }
  void NumberRows(const char* name, std::vector<std::vector<double>>* rows,
                  const std::vector<OptionColumn>&, std::size_t) override {
    if (rows->empty()) return Line(name, "[]");
    text += std::string(indent_, ' ') + name + ":\n";
    for (const std::vector<double>& row : *rows) {
      text += std::string(indent_ + 2, ' ') + fmt::format("- [{}]\n", fmt::join(row, ", "));
    }
  }
  void FolderPoses(const char* name, std::map<std::string, SE3>* poses, double) override {
    if (poses->empty()) return Line(name, "{}");
    BeginGroup(name);
    for (const auto& [folder, T] : *poses) {
      YAML::Emitter quoted;
      quoted << YAML::DoubleQuoted << folder;
      Line(quoted.c_str(), fmt::format("[{}, {}, {}, {}, {}, {}, {}]", T.t.x(), T.t.y(), T.t.z(),
                                       T.q.x(), T.q.y(), T.q.z(), T.q.w()));
    }
    EndGroup();
  }
  void BeginGroup(const char* name) override {
    text += std::string(indent_, ' ') + name + ":\n";
    indent_ += 2;
  }
  void EndGroup() override { indent_ -= 2; }

  std::string text;

 private:
  void Line(const char* name, const std::string& value) {
    text += std::string(indent_, ' ') + name + ": " + value + "\n";
  }
  std::size_t indent_ = 0;
};

void Apply(const Settings& settings, const VisitOptions& visit) {
  Assigner assigner(settings);
  visit(assigner);
  RefuseUnknown(settings, assigner.names());
}

}  // namespace

void ReadOptions(const std::string& path, const std::vector<std::string>& key_values,
                 const VisitOptions& visit) {
  if (!path.empty()) Apply(ReadYaml(path), visit);
  Settings pairs;
  for (const std::string& pair : key_values) {
    const std::size_t equals = pair.find('=');
    if (equals == std::string::npos || equals == 0) {
      throw OptionError(fmt::format("--set {}: must have the form key=value", pair));
    }
    pairs[pair.substr(0, equals)] = {pair.substr(equals + 1), "--set " + pair, false};
  }
  Apply(pairs, visit);
}

std::string OptionsToYaml(const VisitOptions& visit) {
  Emitter emitter;
  visit(emitter);
  return emitter.text;
}

std::vector<std::string> OptionNames(const VisitOptions& visit) {
  const Settings none;
  Assigner assigner(none);
  visit(assigner);
  return assigner.names();
}

std::string UnknownConfig(const std::string& path) {
  std::vector<std::string> names;
  for (const ShippedConfig& config : ShippedConfigs()) names.push_back(config.name);
  const std::filesystem::path file(path);
  const std::string meant = LikelyName(file.stem().string(), names);
  return fmt::format(
      "there is no configuration {}, no file and none that is shipped{} Shipped are {}", path,
      meant.empty() ? "." : "; did you mean " + meant + "?", JoinNames(names));
}

}  // namespace lamina
