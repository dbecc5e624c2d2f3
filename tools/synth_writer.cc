#include "tools/synth_writer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string_view>
#include <system_error>
#include <vector>

#include "core/error.h"
#include "core/parallel.h"
#include "io/file_writer.h"
#include "io/trajectory_io.h"

namespace lamina {
namespace {

// Scans in flight at once. A fixed number: memory must not depend on the machine.
constexpr std::size_t kBatch = 8;

namespace fs = std::filesystem;

fs::path ScanPath(const fs::path& velodyne, std::size_t i) {
  return velodyne / fmt::format("{:06d}.bin", i);
}

void WriteWhole(const fs::path& path, std::string_view bytes) {
  FileWriter file(path.string());
  file.Write(bytes);
  file.Commit();
}

// Without FileWriter's wait for the disk, which would halve the speed: after a power cut the
// sequence is made again.
void WriteScan(const fs::path& path, const std::vector<ScanPoint>& points) {
  std::FILE* const file = std::fopen(path.c_str(), "wbe");
  bool good = file != nullptr;
  good =
      good && std::fwrite(points.data(), sizeof(ScanPoint), points.size(), file) == points.size();
  if (file) good = std::fclose(file) == 0 && good;
  if (!good) {
    throw OutputError(
        fmt::format("{}: cannot be written: {}", path.string(), std::strerror(errno)));
  }
}

void MakeDirectory(const fs::path& velodyne, std::size_t scans) {
  std::error_code error;
  fs::create_directories(velodyne, error);
  if (error) {
    throw OutputError(fmt::format("{}: cannot be created: {}", velodyne.string(), error.message()));
  }
  if (fs::exists(ScanPath(velodyne, scans), error)) {
    throw OutputError(
        fmt::format("{}: holds scans of a longer sequence ({}); remove them or choose another "
                    "directory",
                    velodyne.string(), ScanPath("", scans).string()));
  }
}

void WriteTexts(const SynthSequence& sequence, const fs::path& directory,
                const std::string& truth_path) {
  constexpr StampNs kSecond = 1000000000;
  std::string times;
  Trajectory truth;
  truth.reserve(sequence.size());
  for (std::size_t i = 0; i < sequence.size(); ++i) {
    const StampNs stamp = sequence.Stamp(i);
    times += fmt::format("{}.{:09d}\n", stamp / kSecond, stamp % kSecond);
    truth.push_back({stamp, sequence.TruePose(i)});
  }
  std::string calibration;
  for (const char* name : {"P0", "P1", "P2", "P3", "Tr"}) {
    calibration += fmt::format("{}: 1 0 0 0 0 1 0 0 0 0 1 0\n", name);
  }
  WriteWhole(directory / "times.txt", times);
  WriteWhole(directory / "calib.txt", calibration);
  WriteKittiTrajectory(truth_path, truth);
}

}  // namespace

WrittenSequence WriteSequence(const SynthOptions& options, const std::string& directory,
                              const SynthProgress& progress) {
  const SynthSequence sequence(options);
  const fs::path velodyne = fs::path(directory) / "velodyne";
  WrittenSequence written;
  written.truth_path = (fs::path(directory) / "poses.txt").string();
  MakeDirectory(velodyne, sequence.size());
  WriteTexts(sequence, directory, written.truth_path);
  while (written.frames < sequence.size()) {
    const std::size_t count = std::min(kBatch, sequence.size() - written.frames);
    std::vector<std::size_t> points(count);
    ParallelChunks(count, 1, [&](std::size_t begin, std::size_t) {
      const std::size_t i = written.frames + begin;
      const Scan scan = sequence.Generate(i);
      WriteScan(ScanPath(velodyne, i), scan.points);
      points[begin] = scan.points.size();
    });
    for (const std::size_t n : points) written.points += n;
    written.frames += count;
    if (progress) progress(written.frames, sequence.size());
  }
  return written;
}

}  // namespace lamina
