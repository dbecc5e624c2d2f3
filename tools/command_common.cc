#include "tools/command_common.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <csignal>
#include <filesystem>

#include "core/error.h"
#include "io/file_writer.h"
#include "io/trajectory_io.h"
#include "tools/posed_scans.h"

namespace lamina {
namespace {

// Set by Ctrl-C. A signal handler may touch nothing else.
std::atomic<bool> stop_requested{false};

void RequestStop(int) {
  stop_requested = true;
  // A second Ctrl-C ends the program at once.
  std::signal(SIGINT, SIG_DFL);
}

std::size_t ParseIndex(const std::string& text, std::size_t fallback, const std::string& whole) {
  if (text.empty()) return fallback;
  std::size_t value = 0;
  const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error == std::errc() && rest == text.data() + text.size()) return value;
  throw OptionError(
      fmt::format("--frames {}: must have the form A:B, with whole numbers 0 <= A < B", whole));
}

}  // namespace

FrameRange ParseFrameRange(const std::string& text, std::size_t size) {
  if (text.empty()) return {0, size};
  const std::size_t colon = text.find(':');
  if (colon == std::string::npos) ParseIndex("-", 0, text);
  const FrameRange range = {ParseIndex(text.substr(0, colon), 0, text),
                            std::min(size, ParseIndex(text.substr(colon + 1), size, text))};
  if (range.begin < range.end) return range;
  throw OptionError(fmt::format("--frames {}: names none of the {} scans", text, size));
}

void WriteTextFile(const std::string& path, const std::string& text) {
  FileWriter writer(path);
  writer.Write(text);
  writer.Commit();
}

RunProgress::Mode ProgressMode(const std::string& name) {
  return name == "on"    ? RunProgress::Mode::kOn
         : name == "off" ? RunProgress::Mode::kOff
                         : RunProgress::Mode::kAuto;
}

std::unique_ptr<tbb::global_control> LimitThreads(int threads) {
  constexpr int kMost = 1024;
  if (threads < 0 || threads > kMost) {
    throw OptionError(fmt::format("--threads = {}: must be in [0, {}]", threads, kMost));
  }
  if (threads == 0) return nullptr;
  return std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism,
                                               static_cast<std::size_t>(threads));
}

const std::atomic<bool>& StopOnSignals() {
  std::signal(SIGINT, RequestStop);
  std::signal(SIGTERM, RequestStop);
  return stop_requested;
}

TrajectoryErrors CompareWithTruth(const std::string& path, const ScanSource& source,
                                  const Trajectory& poses) {
  Trajectory truth =
      CameraToLidar(ReadTrajectory(path, ScanStamps(source)), source.T_camera_lidar());
  Trajectory estimate = poses;
  constexpr double kToleranceS = 1e-3;
  MatchByStamp(kToleranceS, &estimate, &truth);
  return CompareTrajectories(estimate, truth, Alignment::kSe3);
}

}  // namespace lamina
