// What can be told of a recording without mapping it.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "config/config.h"
#include "io/container/message_container.h"
#include "io/recording/scan_source.h"

namespace lamina {

// The rate of scans and what is missing among them, by their stamps.
struct ScanRate {
  double span_s = 0.0;    // from the first to the last
  double period_s = 0.0;  // the median of the steps forward; 0: there is none
  std::size_t gaps = 0;   // steps of more than one and a half periods
  std::size_t missing = 0;
  double longest_gap_s = 0.0;
  std::size_t longest_gap_after = 0;  // the scan before it
  std::size_t back = 0;               // stamps that are not after the one before
};
ScanRate MeasureRate(const std::vector<StampNs>& stamps);

// "10 scans over 0.932 s, 9.65 Hz; 2 gaps ...".
std::string DescribeRate(std::size_t scans, const ScanRate& rate);

// A line for each topic.
std::string DescribeTopics(const MessageContainer& container);

// The paragraph of one topic, or of a recording without topics. `path` and `topic` are what the
// command to type shall name; `topic` is empty where it need not be told.
std::string DescribeScans(const ScanSource& source, const LaminaConfig& config,
                          const std::string& path, const std::string& topic);

}  // namespace lamina
