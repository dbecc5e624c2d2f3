// Results of long work, kept so that it can go on after it was interrupted.
#pragma once

#include <optional>
#include <string>

namespace lamina {

// Not thread-safe. A result is that of a pure function of its key and of what does not change while
// the journal is kept; the work is the same with a journal or without.
class ResultJournal {
 public:
  virtual ~ResultJournal() = default;
  ResultJournal() = default;
  ResultJournal(const ResultJournal&) = delete;
  ResultJournal& operator=(const ResultJournal&) = delete;

  virtual std::optional<std::string> Find(const std::string& key) const = 0;
  virtual void Add(const std::string& key, const std::string& result) = 0;
  // What was added is safe when this returns.
  virtual void Sync() = 0;
};

}  // namespace lamina
