#include "core/options/options.h"

#include <algorithm>
#include <sstream>

#include "core/base/printable_text.h"
#include "core/geometry/se3.h"

namespace lamina {
namespace {

template <typename T>
void CheckRange(const std::string& name, T value, T low, T high) {
  if (value >= low && value <= high) return;
  std::ostringstream message;
  message << name << " = " << value << ": must be in [" << low << ", " << high << "]";
  throw OptionError(message.str());
}

}  // namespace

void NamedOptionVisitor::BeginGroup(const char* name) { prefix_ = FullName(name); }

void NamedOptionVisitor::EndGroup() {
  const size_t dot = prefix_.rfind('.');
  prefix_ = dot == std::string::npos ? "" : prefix_.substr(0, dot);
}

std::string NamedOptionVisitor::FullName(const char* name) const {
  return prefix_.empty() ? name : prefix_ + "." + name;
}

void OptionChecker::Number(const char* name, double* value, double low, double high) {
  CheckRange(FullName(name), *value, low, high);
}

void OptionChecker::Integer(const char* name, int* value, int low, int high) {
  CheckRange(FullName(name), *value, low, high);
}

void OptionLimiter::Number(const char*, double* value, double low, double high) {
  *value = std::clamp(*value, low, high);
}

void OptionLimiter::Integer(const char*, int* value, int low, int high) {
  *value = std::clamp(*value, low, high);
}

void OptionChecker::Choice(const char* name, int* index, const std::vector<std::string>& names) {
  CheckRange(FullName(name), *index, 0, static_cast<int>(names.size()) - 1);
}

void OptionChecker::Text(const char* name, std::string* value, std::size_t most_bytes) {
  if (value->size() <= most_bytes && Printable(*value) == *value) return;
  throw OptionError(FullName(name) + " = '" + Printable(value->substr(0, most_bytes)) +
                    "': must be printable text of at most " + std::to_string(most_bytes) +
                    " bytes");
}

void OptionChecker::NumberRows(const char* name, std::vector<std::vector<double>>* rows,
                               const std::vector<OptionColumn>& columns, std::size_t most) {
  if (rows->size() > most) {
    throw OptionError(FullName(name) + ": at most " + std::to_string(most) + " rows, not " +
                      std::to_string(rows->size()));
  }
  for (std::size_t r = 0; r < rows->size(); ++r) {
    const std::vector<double>& row = (*rows)[r];
    const std::string of_row = FullName(name) + ", row " + std::to_string(r + 1);
    if (row.size() != columns.size()) {
      throw OptionError(of_row + ": must be " + std::to_string(columns.size()) + " numbers, not " +
                        std::to_string(row.size()));
    }
    for (std::size_t c = 0; c < columns.size(); ++c) {
      CheckRange(of_row + ", " + columns[c].name, row[c], columns[c].low, columns[c].high);
    }
  }
}

void OptionChecker::FolderPoses(const char* name, std::map<std::string, SE3>* poses,
                                double most_m) {
  constexpr double kUnit = 1e-6;
  for (const auto& [folder, pose] : *poses) {
    if (folder.empty() || folder.front() == '/' || folder.back() == '/') {
      throw OptionError(FullName(name) + ": '" + folder +
                        "' must be the name of a folder, without a slash at either end");
    }
    const std::string of_folder = FullName(name) + "." + folder;
    for (int i = 0; i < 3; ++i) {
      CheckRange(of_folder + " " + "xyz"[i], pose.t(i), -most_m, most_m);
    }
    CheckRange(of_folder + " length of the quaternion", pose.q.norm(), 1.0 - kUnit, 1.0 + kUnit);
  }
}

}  // namespace lamina
