#include "tools/synth/writer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string_view>
#include <system_error>
#include <vector>

#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/map/voxel_key.h"
#include "io/file/file_writer.h"
#include "io/map/map_io.h"
#include "io/map/trajectory_io.h"
#include "tools/cli/common.h"

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

void MakeScanDirectory(const fs::path& velodyne, std::size_t scans) {
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

constexpr StampNs kSecond = 1000000000;

void WriteTexts(const Trajectory& truth, bool timed, const fs::path& directory,
                const std::string& truth_path) {
  std::string times;
  for (const StampedPose& pose : truth) {
    times += fmt::format("{}.{:09d}\n", pose.stamp_ns / kSecond, pose.stamp_ns % kSecond);
  }
  std::string calibration;
  for (const char* name : {"P0", "P1", "P2", "P3", "Tr"}) {
    calibration += fmt::format("{}: 1 0 0 0 0 1 0 0 0 0 1 0\n", name);
  }
  std::error_code none_there;
  if (timed) {
    WriteWhole(directory / "times.txt", times);
  } else {
    fs::remove(directory / "times.txt", none_there);
  }
  WriteWhole(directory / "calib.txt", calibration);
  WriteKittiTrajectory(truth_path, truth);
}

// Scan after scan, several at once; `write` takes scan i.
void WriteAll(std::size_t scans, const std::function<Scan(std::size_t)>& make,
              const std::function<void(std::size_t, const Scan&)>& write,
              const SynthProgress& progress, WrittenSequence* written) {
  while (written->frames < scans) {
    const std::size_t count = std::min(kBatch, scans - written->frames);
    std::vector<std::size_t> points(count);
    ParallelChunks(count, 1, [&](std::size_t begin, std::size_t) {
      const std::size_t i = written->frames + begin;
      const Scan scan = make(i);
      write(i, scan);
      points[begin] = scan.points.size();
    });
    for (const std::size_t n : points) written->points += n;
    written->frames += count;
    if (progress) progress(written->frames, scans);
  }
}

void WriteHokuyoCsv(const fs::path& path, const Scan& scan) {
  std::string text = "timestamp,x,y,z,intensities\n";
  const std::string stamp =
      fmt::format("{}.{:09d}", scan.stamp_ns / kSecond, scan.stamp_ns % kSecond);
  for (const ScanPoint& p : scan.points) {
    text += fmt::format("{},{},{},{},{}\n", stamp, p.x, p.y, p.z, p.intensity);
  }
  WriteWhole(path, text);
}

void WriteLeicaPoses(const std::string& path, const Trajectory& truth) {
  std::string text = "poseId,timestamp";
  for (int i = 0; i < 16; ++i) text += fmt::format(",T{}{}", i / 4, i % 4);
  text += "\n";
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const StampNs stamp = truth[i].stamp_ns;
    text += fmt::format("{},{}.{:09d}", i, stamp / kSecond, stamp % kSecond);
    const Eigen::Matrix3d R = truth[i].T_world_lidar.R();
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) text += fmt::format(",{}", R(row, column));
      text += fmt::format(",{}", truth[i].T_world_lidar.t(row));
    }
    text += ",0,0,0,1\n";
  }
  WriteWhole(path, text);
}

// The first point in each voxel.
class Thinning {
 public:
  static constexpr double kVoxelM = 0.03;
  void Add(const std::vector<Eigen::Vector3f>& points, std::vector<ScanPoint>* kept) {
    for (const Eigen::Vector3f& p : points) {
      const VoxelKey key = VoxelKeyOf(p.cast<double>(), 1.0 / kVoxelM);
      if (seen_.Insert(key)) kept->push_back({p.x(), p.y(), p.z(), 0.0F});
    }
  }

 private:
  VoxelIndex seen_;
};

}  // namespace

WrittenSequence WriteScans(const Trajectory& truth, const std::function<Scan(std::size_t)>& make,
                           const std::string& directory, const SynthProgress& progress,
                           bool timed) {
  const fs::path velodyne = fs::path(directory) / "velodyne";
  WrittenSequence written;
  written.truth_path = (fs::path(directory) / "poses.txt").string();
  MakeScanDirectory(velodyne, truth.size());
  WriteTexts(truth, timed, directory, written.truth_path);
  WriteAll(
      truth.size(), make,
      [&](std::size_t i, const Scan& scan) { WriteScan(ScanPath(velodyne, i), scan.points); },
      progress, &written);
  return written;
}

WrittenSequence WriteSequence(const SynthOptions& options, const std::string& directory,
                              const SynthProgress& progress) {
  const SynthSequence sequence(options);
  Trajectory truth;
  truth.reserve(sequence.size());
  for (std::size_t i = 0; i < sequence.size(); ++i) {
    truth.push_back({sequence.Stamp(i), sequence.TruePose(i)});
  }
  return WriteScans(
      truth, [&](std::size_t i) { return sequence.Generate(i); }, directory, progress,
      !options.untimed);
}

WrittenSequence WriteStations(const StationOptions& options, StationLayout layout,
                              const std::string& directory, const SynthProgress& progress) {
  const StationSequence sequence(options);
  const Trajectory truth = sequence.Truth();
  std::vector<std::vector<ScanPoint>> surfaces(truth.size());
  const auto make = [&](std::size_t i) {
    std::vector<Eigen::Vector3f> surface;
    Scan scan = sequence.Generate(i, &surface);
    Thinning().Add(surface, &surfaces[i]);
    return scan;
  };
  const fs::path folder(directory);
  WrittenSequence written;
  if (layout == StationLayout::kKitti) {
    written = WriteScans(truth, make, directory, progress);
  } else {
    written.truth_path = (folder / "pose_scanner_leica.csv").string();
    MakeDirectory(directory);
    WriteLeicaPoses(written.truth_path, truth);
    WriteAll(
        truth.size(), make,
        [&](std::size_t i, const Scan& scan) {
          WriteHokuyoCsv(folder / fmt::format("Hokuyo_{}.csv", i), scan);
        },
        progress, &written);
  }
  Thinning thinning;
  CloudWriter reference((folder / "reference.ply").string());
  for (const std::vector<ScanPoint>& surface : surfaces) {
    std::vector<Eigen::Vector3f> points;
    for (const ScanPoint& p : surface) points.emplace_back(p.x, p.y, p.z);
    std::vector<ScanPoint> kept;
    thinning.Add(points, &kept);
    reference.Append(kept);
  }
  reference.Commit();
  return written;
}

}  // namespace lamina
