// How options describe themselves.
//
// Each algorithm has a plain struct of options beside its class, with the defaults as member
// initialisers and one member function
//
//     void Visit(OptionVisitor& v) { v.Number("max_range_m", &max_range_m, 1.0, 1e3); ... }
//
// that names every option once, with its rule. Checking, reading YAML, `--set key=value` and
// writing the effective configuration are visitors; so an option's name, default and range have one
// home.
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "core/base/error.h"

namespace lamina {

struct SE3;

// A column of a list of rows of numbers, and its range.
struct OptionColumn {
  const char* name;
  double low, high;
};

class OptionVisitor {
 public:
  virtual ~OptionVisitor() = default;
  // A real number in [low, high].
  virtual void Number(const char* name, double* value, double low, double high) = 0;
  // A whole number in [low, high].
  virtual void Integer(const char* name, int* value, int low, int high) = 0;
  virtual void Flag(const char* name, bool* value) = 0;
  // One of `names`; *index is its position.
  virtual void Choice(const char* name, int* index, const std::vector<std::string>& names) = 0;
  // At most `most_bytes` of printable text.
  virtual void Text(const char* name, std::string* value, std::size_t most_bytes) = 0;
  // At most `most` rows of one real number for each column.
  virtual void NumberRows(const char* name, std::vector<std::vector<double>>* rows,
                          const std::vector<OptionColumn>& columns, std::size_t most) = 0;
  // Poses of the folders that the user names, with no coordinate beyond `most_m`.
  virtual void FolderPoses(const char* name, std::map<std::string, SE3>* poses, double most_m) = 0;
  virtual void BeginGroup(const char* name) = 0;
  virtual void EndGroup() = 0;

  template <typename Enum>
  void EnumChoice(const char* name, Enum* value, const std::vector<std::string>& names) {
    int index = static_cast<int>(*value);
    Choice(name, &index, names);
    *value = static_cast<Enum>(index);
  }
  template <typename Options>
  void Group(const char* name, Options* options) {
    BeginGroup(name);
    options->Visit(*this);
    EndGroup();
  }
};

// Follows the dotted name ("frontend.matcher.max_iterations") of the option being visited.
class NamedOptionVisitor : public OptionVisitor {
 public:
  explicit NamedOptionVisitor(std::string prefix = "") : prefix_(std::move(prefix)) {}
  void BeginGroup(const char* name) override;
  void EndGroup() override;

 protected:
  std::string FullName(const char* name) const;

 private:
  std::string prefix_;
};

// Throws OptionError, naming value and rule, if any option is out of range. NaN is out of range.
class OptionChecker final : public NamedOptionVisitor {
 public:
  using NamedOptionVisitor::NamedOptionVisitor;
  void Number(const char* name, double* value, double low, double high) override;
  void Integer(const char* name, int* value, int low, int high) override;
  void Flag(const char*, bool*) override {}
  void Choice(const char* name, int* index, const std::vector<std::string>& names) override;
  void Text(const char* name, std::string* value, std::size_t most_bytes) override;
  void NumberRows(const char* name, std::vector<std::vector<double>>* rows,
                  const std::vector<OptionColumn>& columns, std::size_t most) override;
  void FolderPoses(const char* name, std::map<std::string, SE3>* poses, double most_m) override;
};

// Brings numbers that are out of range to the nearest that are in it.
class OptionLimiter final : public OptionVisitor {
 public:
  void Number(const char* name, double* value, double low, double high) override;
  void Integer(const char* name, int* value, int low, int high) override;
  void Flag(const char*, bool*) override {}
  void Choice(const char*, int*, const std::vector<std::string>&) override {}
  void Text(const char*, std::string*, std::size_t) override {}
  void NumberRows(const char*, std::vector<std::vector<double>>*, const std::vector<OptionColumn>&,
                  std::size_t) override {}
  void FolderPoses(const char*, std::map<std::string, SE3>*, double) override {}
  void BeginGroup(const char*) override {}
  void EndGroup() override {}
};

// Of options that an algorithm derives from those of its user, such as voxels of twice the size:
// what the user may give must not fail when it is doubled.
template <typename Options>
Options WithinRange(Options options) {
  OptionLimiter limiter;
  options.Visit(limiter);
  return options;
}

// Every algorithm calls this on the options that it is constructed with.
template <typename Options>
void CheckOptions(Options options, const std::string& prefix) {
  OptionChecker checker(prefix);
  options.Visit(checker);
}

}  // namespace lamina
