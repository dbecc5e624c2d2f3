#include "core/options.h"

#include <sstream>

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

void OptionChecker::Choice(const char* name, int* index, const std::vector<std::string>& names) {
  CheckRange(FullName(name), *index, 0, static_cast<int>(names.size()) - 1);
}

}  // namespace lamina
