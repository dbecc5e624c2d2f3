// How much memory this process has, and has had at most.
#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <fstream>
#include <string>

#include "tests/support/sanitizers.h"

namespace lamina {

// A line of /proc/self/status, in kB.
inline std::size_t StatusKb(const char* name) {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    std::size_t value = 0;
    if (word == name && status >> value) return value;
  }
  return 0;
}

// Expects that what is done in its life takes no more than 64 MB, and so much beside. Sanitizers
// keep what was freed: under them nothing is expected.
class ExpectBoundedMemory {
 public:
  explicit ExpectBoundedMemory(std::size_t beside_bytes = 0)
      : most_kb_((64U << 10) + (beside_bytes >> 10)) {
    std::ofstream("/proc/self/clear_refs") << "5";
    before_kb_ = StatusKb("VmRSS:");
  }
  ~ExpectBoundedMemory() {
    if (!kSanitized) {
      EXPECT_LT(StatusKb("VmHWM:"), before_kb_ + most_kb_);
    }
  }
  ExpectBoundedMemory(const ExpectBoundedMemory&) = delete;
  ExpectBoundedMemory& operator=(const ExpectBoundedMemory&) = delete;

 private:
  std::size_t most_kb_, before_kb_ = 0;
};

}  // namespace lamina
