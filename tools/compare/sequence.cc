#include "tools/compare/sequence.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <memory>

#include "core/base/angle.h"
#include "core/base/error.h"
#include "core/base/parallel.h"
#include "frontend/pairwise/pairwise_registration.h"
#include "io/map/trajectory_io.h"
#include "tools/cli/common.h"
#include "tools/compare/structure.h"
#include "tools/synth/engine/random.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using Initial = CompareSettings::Initial;

bool NeedsInitial(const std::string& method) {
  const CompareGroup group = FindMethod(method).group;
  return group != CompareGroup::kGlobal && group != CompareGroup::kSynchronised;
}

const CompareJob kTeaserJob = {"teaser", "sync_teaser"};

// Longest first, so that at the end no processor waits long for another. What takes long is the
// same everywhere; the order changes no result.
void PutLongestFirst(std::vector<CompareTask>* tasks) {
  static const std::vector<std::string> kLong = {
      "f2m_ndt",         "f2m_icp_point",    "f2f_ndt",     "f2f_icp_point",
      "plane_landmarks", "eigen_factors_lm", "sync_teaser", "eigen_factors",
      "f2m_icp_plane",   "f2m_gicp",         "sync_fgr",    "huang"};
  const auto rank = [](const CompareTask& task) {
    return std::find_first_of(kLong.begin(), kLong.end(), task.methods.begin(),
                              task.methods.end()) -
           kLong.begin();
  };
  std::stable_sort(tasks->begin(), tasks->end(),
                   [&](const CompareTask& a, const CompareTask& b) { return rank(a) < rank(b); });
}

std::vector<SE3> NoisyPoses(const std::vector<SE3>& truth, const CompareSettings& settings) {
  std::vector<SE3> poses = truth;
  for (std::size_t k = 1; k < poses.size(); ++k) {
    Vector6d delta;
    for (int i = 0; i < 6; ++i) {
      const double sigma =
          i < 3 ? Radians(settings.noise_rotation_deg) : settings.noise_translation_m;
      const auto hash = synth::HashOf({settings.seed, 0x1417, static_cast<std::int64_t>(k), i});
      delta(i) = sigma * static_cast<double>(synth::GaussianFrom(hash));
    }
    poses[k] = Retract(poses[k], delta);
  }
  return poses;
}

// Points of each scan, thinned for maps.
std::vector<std::vector<Eigen::Vector3f>> ReadThinned(const std::string& path,
                                                      const CompareConfig& config) {
  const auto source = OpenScans(path, config.lamina.scans);
  std::vector<std::vector<Eigen::Vector3f>> scans;
  for (std::size_t i = 0; i < source->size(); ++i) {
    std::vector<Eigen::Vector3f> points;
    for (const TimedPoint& p :
         PrepareScan(source->Read(i), config.lamina.preparation, 0.1, source->T_vehicle_lidar(i))
             .points) {
      points.emplace_back(p.x, p.y, p.z);
    }
    // Returns themselves and not means of voxels, which lie beside edges.
    VoxelIndex taken;
    std::vector<Eigen::Vector3f> kept;
    constexpr double kInverseVoxel = 10.0;
    for (const Eigen::Vector3f& p : points) {
      if (taken.Insert(VoxelKeyOf(p.cast<double>(), kInverseVoxel))) kept.push_back(p);
    }
    scans.push_back(std::move(kept));
  }
  return scans;
}

}  // namespace

// What the rows of one sequence share while they are made.
struct Comparison::Work {
  std::string folder, fingerprint, initial_path;
  std::function<const CompareFiles&()> files;  // made when first asked for
  std::size_t scans = 0;
  std::string name;
};

Comparison::Comparison(const CompareSettings& settings, const std::atomic<bool>& stop)
    : settings_(settings), stop_(stop) {
  MakeDirectory(settings_.out);
  config_path_ = (fs::path(settings_.out) / "config.yaml").string();
  config_text_ = ToYaml(settings_.config);
  WriteTextFile(config_path_, config_text_);
}

std::string Comparison::RowFolder(const std::string& sequence) const {
  return (fs::path(settings_.out) / "rows" / sequence).string();
}

std::string Comparison::FingerprintOf(const CompareSequence& sequence,
                                      const std::string& config) const {
  std::string text =
      sequence.identity + "\n" + config +
      fmt::format("\n{} {} {} {}\n", static_cast<int>(settings_.initial_kind),
                  settings_.noise_rotation_deg, settings_.noise_translation_m, settings_.seed);
  for (const SE3& T : settings_.initial) {
    text +=
        fmt::format("{} {} {} {} {} {}\n", T.q.x(), T.q.y(), T.q.z(), T.t.x(), T.t.y(), T.t.z());
  }
  return Fingerprint(text);
}

CompareJob Comparison::Missing(const CompareJob& job, const Work& work) const {
  CompareJob missing;
  for (const std::string& method : job) {
    const auto row = ReadRow(RowPath(work.folder, method), work.fingerprint);
    const bool more_time =
        row && row->time_limit_s > 0.0 && row->time_limit_s < settings_.time_limit_s;
    if (!row || more_time) missing.push_back(method);
  }
  return missing;
}

bool Comparison::RunTasks(const std::vector<CompareTask>& tasks, const Wording& wording,
                          std::size_t scans, std::size_t at_once) const {
  std::size_t steps = 0;
  for (const CompareTask& task : tasks) steps += StepsOf(task, scans);
  RunProgress progress(settings_.progress, steps, "scans " + wording.of);
  CompareJobReports reports;
  reports.on_step = [&] { progress.Step(); };
  reports.on_failure = [&](const CompareRow& row) {
    progress.Warn(fmt::format("{} {} failed: {}", row.method, wording.on, row.reason));
  };
  const bool done = RunCompareTasks(tasks, scans, at_once, stop_, reports);
  progress.Finish();
  return done;
}

void Comparison::RunJobs(const std::vector<CompareJob>& jobs, Work* work) {
  std::vector<CompareTask> tasks;
  for (const CompareJob& job : jobs) {
    CompareTask task;
    task.methods = Missing(job, *work);
    if (task.methods.empty()) continue;
    task.sequence = work->name;
    task.fingerprint = work->fingerprint;
    task.scans = work->files().scans;
    task.initial = work->initial_path;
    task.config = config_path_;
    task.row_folder = work->folder;
    task.time_limit_s = settings_.time_limit_s;
    tasks.push_back(std::move(task));
  }
  if (tasks.empty()) return;
  PutLongestFirst(&tasks);
  const bool done =
      RunTasks(tasks, {"of " + work->name, "on " + work->name}, work->scans, settings_.at_once);
  if (!done) {
    throw InterruptedError(
        fmt::format("the rows that are finished stay in {}/rows, and the same call goes on from "
                    "there",
                    settings_.out));
  }
}

bool Comparison::InitialPoses(const CompareSequence& sequence, std::vector<SE3>* poses,
                              std::string* reason) const {
  if (settings_.initial_kind == Initial::kFile) {
    *poses = settings_.initial;
    return true;
  }
  if (settings_.initial_kind == Initial::kNoisyTruth) {
    *poses = NoisyPoses(sequence.truth, settings_);
    return true;
  }
  const auto row = ReadRow(RowPath(RowFolder(sequence.name), "sync_teaser"),
                           FingerprintOf(sequence, config_text_));
  if (!row || !row->good) {
    *reason = "no initial poses, teaser failed: " + (row ? row->reason : "it made no row");
    return false;
  }
  *poses = row->poses;
  return true;
}

std::string Comparison::WriteInitialPoses(const CompareSequence& sequence,
                                          const std::vector<SE3>& poses) const {
  Trajectory trajectory;
  for (const SE3& T : poses) trajectory.push_back({0, T});
  const std::string path = (fs::path(RowFolder(sequence.name)) / "initial.txt").string();
  WriteKittiTrajectory(path, trajectory);
  return path;
}

void Comparison::MakeRows(const CompareSequence& sequence, Work* work) {
  std::vector<CompareJob> first, second;
  for (const CompareJob& job : GroupIntoJobs(settings_.methods)) {
    (NeedsInitial(job.front()) ? second : first).push_back(job);
  }
  const bool any_missing = std::any_of(second.begin(), second.end(), [&](const CompareJob& job) {
    return !Missing(job, *work).empty();
  });
  if (settings_.initial_kind == Initial::kTeaser && !second.empty()) {
    first.erase(std::remove_if(first.begin(), first.end(),
                               [](const CompareJob& job) {
                                 return std::find(job.begin(), job.end(), "sync_teaser") !=
                                            job.end() ||
                                        job.front() == "teaser";
                               }),
                first.end());
    first.insert(first.begin(), kTeaserJob);
  }
  RunJobs(first, work);
  if (!any_missing) return;
  std::vector<SE3> initial;
  std::string reason;
  if (InitialPoses(sequence, &initial, &reason)) {
    work->initial_path = WriteInitialPoses(sequence, initial);
    RunJobs(second, work);
    return;
  }
  for (const CompareJob& job : second) {
    for (const std::string& method : job) {
      CompareRow row;
      row.sequence = work->name;
      row.method = method;
      row.fingerprint = work->fingerprint;
      row.reason = reason;
      WriteRow(RowPath(work->folder, method), row);
    }
  }
}

void Comparison::MeasureStructures(const CompareSequence& sequence, Work* work,
                                   CompareColumn* column) {
  const auto picture = [&](const std::string& method) {
    return (fs::path(settings_.out) / (sequence.name + "_" + method + "_heat.png")).string();
  };
  std::vector<std::string> todo;
  for (const auto& [method, cell] : column->cells) {
    const bool drawn = std::find(settings_.heat_maps.begin(), settings_.heat_maps.end(), method) ==
                           settings_.heat_maps.end() ||
                       fs::exists(picture(method));
    if (cell.row.good && (!cell.row.structure || !drawn)) todo.push_back(method);
  }
  if (todo.empty() || work->files().reference.empty()) return;
  const ReferenceCloud reference(work->files().reference);
  const auto scans = ReadThinned(work->files().scans, settings_.config);
  double top = std::numeric_limits<double>::lowest();
  constexpr double kAboveScannerM = 0.8;
  for (const SE3& T : sequence.truth) top = std::max(top, T.t.z() + kAboveScannerM);
  const auto measure = [&](const std::string& method) {
    CompareRow& row = column->cells.at(method).row;
    const auto map = MeasureStructure(scans, row.poses, sequence.truth, reference);
    row.structure = Summarise(map);
    WriteRow(RowPath(work->folder, method), row);
    const auto& wanted = settings_.heat_maps;
    if (std::find(wanted.begin(), wanted.end(), method) == wanted.end()) return;
    const fs::path path = picture(method);
    WriteHeatMap(fs::path(path).replace_extension(".ply").string(), map);
    DrawHeatMap(path.string(), FindMethod(method).title + ", " + sequence.name, top, map);
  };
  ParallelChunks(todo.size(), 1, [&](std::size_t begin, std::size_t) { measure(todo[begin]); });
}

CompareColumn Comparison::Run(const CompareSequence& sequence) {
  Work work;
  work.folder = RowFolder(sequence.name);
  work.fingerprint = FingerprintOf(sequence, config_text_);
  work.scans = sequence.truth.size();
  work.name = sequence.name;
  std::optional<CompareFiles> files;
  work.files = [&]() -> const CompareFiles& {
    if (!files) files = sequence.open();
    return *files;
  };
  MakeDirectory(work.folder);
  MakeRows(sequence, &work);
  CompareColumn column;
  column.sequence = sequence.name;
  column.scans = work.scans;
  for (const std::string& method : settings_.methods) {
    auto row = ReadRow(RowPath(work.folder, method), work.fingerprint);
    if (!row) throw std::logic_error("no row for " + method);
    CompareCell cell;
    cell.row = std::move(*row);
    if (cell.row.good) cell.errors = CompareAll(cell.row.poses, sequence.truth);
    column.cells.emplace(method, std::move(cell));
  }
  std::vector<SE3> initial;
  std::string ignored;
  column.has_initial = InitialPoses(sequence, &initial, &ignored);
  if (column.has_initial) column.initial = CompareAll(initial, sequence.truth);
  MeasureStructures(sequence, &work, &column);
  if (files && sequence.close) sequence.close();
  return column;
}

}  // namespace lamina
