// Runs the real program as a child process, on small recordings made for the test.
#pragma once

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/scan.h"
#include "io/map/trajectory_io.h"
#include "io/recording/scan_source.h"
#include "tests/support/files/io_test_files.h"
#include "tools/synth/sequence.h"

namespace lamina {

struct Outcome {
  int code = -1;         // exit code; -1: ended by a signal
  std::string out, err;  // what it printed
};

// A scan of a recording: the bytes of its file, and its stamp.
struct RecordedScan {
  std::string bytes;
  double stamp_s = 0.0;
};
using Recording = std::vector<RecordedScan>;

inline std::vector<std::string> Lines(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) lines.push_back(line);
  return lines;
}

// Ten scans a second, of every `thinning`th point; a scan is made when it is first asked for.
class SyntheticDrive {
 public:
  SyntheticDrive(synth::SceneKind scene, int frames, std::size_t thinning)
      : sequence_(OptionsOf(scene, frames)), thinning_(thinning) {}

  // The first ones; no more than there are.
  Recording First(std::size_t count) {
    for (std::size_t i = made_.size(); i < count; ++i) {
      const std::vector<ScanPoint> all = sequence_.Generate(i).points;
      std::vector<ScanPoint> points;
      for (std::size_t k = 0; k < all.size(); k += thinning_) points.push_back(all[k]);
      made_.push_back({KittiBin(points), 1e-9 * static_cast<double>(sequence_.Stamp(i))});
    }
    return {made_.begin(), made_.begin() + static_cast<std::ptrdiff_t>(count)};
  }

 private:
  static SynthOptions OptionsOf(synth::SceneKind scene, int frames) {
    SynthOptions options;
    options.frames = frames;
    options.sensor = synth::SensorKind::kVlp16;
    options.scene = scene;
    return options;
  }

  SynthSequence sequence_;
  std::size_t thinning_;
  Recording made_;
};

inline Recording SyntheticRecording(synth::SceneKind scene, int frames, std::size_t thinning) {
  return SyntheticDrive(scene, frames, thinning).First(static_cast<std::size_t>(frames));
}

// The first `count` <= 40 scans of a drive at 10 m/s through a street. Most tests are a process of
// their own, and need few.
inline Recording Street(std::size_t count) {
  static SyntheticDrive street(synth::SceneKind::kStreet, 40, 1);
  return street.First(count);
}

class RunTest : public FilesTest {
 protected:
  // Writes a sequence in KITTI's layout and returns its folder.
  std::string WriteRecording(const std::string& name, const Recording& recording) const {
    std::ostringstream times;
    times.precision(9);
    times << std::fixed;
    for (std::size_t i = 0; i < recording.size(); ++i) {
      Write(name + "/velodyne/" + ScanName(i), recording[i].bytes);
      times << recording[i].stamp_s << "\n";
    }
    Write(name + "/times.txt", times.str());
    return Path(name);
  }

  // The same scan `count` times, a tenth of a second apart, on the disk once.
  std::string WriteRepeated(const std::string& name, const std::string& bytes,
                            std::size_t count) const {
    WriteRecording(name, {{bytes, 0.0}});
    const std::filesystem::path folder = std::filesystem::path(Path(name)) / "velodyne";
    std::ofstream times(Path(name + "/times.txt"));
    for (std::size_t i = 0; i < count; ++i) {
      times << i / 10 << "." << i % 10 << "\n";
      if (i > 0) std::filesystem::create_hard_link(folder / ScanName(0), folder / ScanName(i));
    }
    return Path(name);
  }

  // Starts the program; what it prints goes to the files "stdout" and "stderr" of the test's
  // folder. `in_child` may set limits before it starts.
  pid_t Start(const std::vector<std::string>& arguments,
              const std::function<void()>& in_child = nullptr) const {
    std::vector<char*> argv{const_cast<char*>(LAMINA_PROGRAM)};
    for (const std::string& a : arguments) argv.push_back(const_cast<char*>(a.c_str()));
    argv.push_back(nullptr);
    const std::string out = Path("stdout"), err = Path("stderr");
    const pid_t child = fork();
    if (child != 0) return child;
    constexpr int kFlags = O_WRONLY | O_CREAT | O_TRUNC;
    if (dup2(open(out.c_str(), kFlags, 0644), STDOUT_FILENO) < 0) _exit(127);
    if (dup2(open(err.c_str(), kFlags, 0644), STDERR_FILENO) < 0) _exit(127);
    if (in_child) in_child();
    execv(argv[0], argv.data());
    _exit(127);
  }

  static bool IsRunning(pid_t child) {
    siginfo_t info{};
    return waitid(P_PID, static_cast<id_t>(child), &info, WEXITED | WNOHANG | WNOWAIT) == 0 &&
           info.si_pid == 0;
  }

  Outcome WaitFor(pid_t child) const {
    int status = 0;
    EXPECT_EQ(waitpid(child, &status, 0), child);
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, Bytes(Path("stdout")),
            Bytes(Path("stderr"))};
  }

  Outcome Lamina(const std::vector<std::string>& arguments,
                 const std::function<void()>& in_child = nullptr) const {
    return WaitFor(Start(arguments, in_child));
  }

  // `lamina run` into the folder "out". Fails the test unless it exits with `code`.
  Outcome Run(const std::string& scans, std::vector<std::string> more = {}, int code = 0,
              const std::string& out = "out") const {
    std::vector<std::string> arguments{"run", "--scans", scans, "--out", Path(out)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    Outcome outcome = Lamina(arguments);
    EXPECT_EQ(outcome.code, code) << outcome.err;
    return outcome;
  }

  nlohmann::json Summary(const std::string& out = "out") const {
    return nlohmann::json::parse(Bytes(Path(out + "/summary.json")), nullptr, false);
  }

  Trajectory AllScans(const std::string& out = "out") const {
    return ReadTrajectory(Path(out + "/trajectory_kitti.txt"), {});
  }

  // Positions by line; both must have the same number of lines.
  static double LargestDistance(const Trajectory& a, const Trajectory& b) {
    EXPECT_EQ(a.size(), b.size());
    double largest = 0.0;
    for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
      largest = std::max(largest, (a[i].T_world_lidar.t - b[i].T_world_lidar.t).norm());
    }
    return largest;
  }

  static std::string ScanName(std::size_t i) {
    const std::string number = std::to_string(i);
    return std::string(6 - number.size(), '0') + number + ".bin";
  }
};

}  // namespace lamina
