// An inbox in a temporary folder, with a clock that the test moves.
#pragma once

#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "io/inbox/inbox.h"
#include "tests/support/files/io_test_files.h"

namespace lamina {

class InboxScene : public FilesTest {
 protected:
  using Woken = Inbox::Woken;

  InboxScene() { std::filesystem::create_directories(Path("in")); }

  void Open() {
    inbox_ = nullptr;
    inbox_ = std::make_unique<Inbox>(
        Path("in"), scans_, options_,
        [this](const std::string& name) {
          ++asked_[name];
          return known_.count(name) > 0;
        },
        [this] { return now_; });
  }
  // Lets the inbox see what is there, then moves the clock.
  void Pass(double seconds) {
    inbox_->Wait(std::chrono::seconds(0));
    now_ +=
        std::chrono::duration_cast<Inbox::Clock::duration>(std::chrono::duration<double>(seconds));
  }

  std::string In(const std::string& name) const { return Path("in/" + name); }
  static std::string OnePoint(float x = 1.0F) { return KittiBin({{x, 0, 0, 0}}); }
  // A scan of one point.
  void Drop(const std::string& name) const { Write("in/" + name, OnePoint()); }
  // As if it had lain there for a minute.
  void Age(const std::string& name) const {
    std::filesystem::last_write_time(
        In(name), std::filesystem::file_time_type::clock::now() - std::chrono::minutes(1));
  }
  void DropOld(const std::string& name) const {
    Drop(name);
    Age(name);
  }

  // All that can be had now.
  std::vector<InboxFile> TakeFiles() {
    std::vector<InboxFile> files;
    for (;;) {
      if (auto file = inbox_->Next()) {
        files.push_back(*file);
      } else if (inbox_->opening()) {
        inbox_->Wait(std::chrono::milliseconds(10));
      } else {
        return files;
      }
    }
  }
  std::vector<std::string> Take() {
    std::vector<std::string> names;
    for (const InboxFile& file : TakeFiles()) names.push_back(file.name);
    return names;
  }
  static std::vector<std::string> Names(const std::vector<InboxNotice>& notices) {
    std::vector<std::string> names;
    for (const InboxNotice& notice : notices) names.push_back(notice.name);
    return names;
  }
  std::vector<std::string> Late() { return Names(inbox_->TakeLate()); }
  std::vector<std::string> Refused() { return Names(inbox_->TakeRefused()); }

  ScanSourceOptions scans_;
  InboxOptions options_;
  std::set<std::string> known_;
  std::map<std::string, int> asked_;
  Inbox::Clock::time_point now_ = Inbox::Clock::time_point(std::chrono::hours(1));
  std::unique_ptr<Inbox> inbox_;
};

}  // namespace lamina
