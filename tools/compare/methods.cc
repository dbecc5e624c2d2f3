#include "tools/compare/methods.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <sstream>
#include <stdexcept>

#include "backend/bundle/formulations/registry.h"
#include "backend/mapping/scan_decoder.h"
#include "backend/registration/batch_registration.h"
#include "core/base/error.h"
#include "core/base/stopwatch.h"
#include "frontend/pairwise/pairwise_odometry.h"
#include "frontend/scan/scan_clusters.h"
#include "tools/compare/config.h"
#include "tools/compare/global_synchronisation.h"
#include "tools/results/verdict/process_report.h"

namespace lamina {
namespace {

using Points = std::vector<Eigen::Vector3f>;

constexpr const char* kFrameToFrame = "f2f_";
constexpr const char* kFrameToMap = "f2m_";
constexpr const char* kSynchronised = "sync_";

bool StartsWith(const std::string& text, const std::string& prefix) {
  return text.rfind(prefix, 0) == 0;
}

// The pairwise method that a row is made by.
std::string BaseName(const std::string& method) {
  for (const std::string prefix : {kFrameToFrame, kFrameToMap, kSynchronised}) {
    if (StartsWith(method, prefix)) return method.substr(prefix.size());
  }
  return method;
}

bool Contains(const CompareJob& job, const std::string& name) {
  return std::find(job.begin(), job.end(), name) != job.end();
}

// Time since the job began, but for what is outside of its charge.
struct Charge {
  Stopwatch watch;
  double cpu_start_s = ProcessCpuSeconds();

  // Calls f outside of the charge.
  template <typename F>
  void Outside(const F& f) {
    const double before = ProcessCpuSeconds();
    watch.Outside(f);
    cpu_start_s += ProcessCpuSeconds() - before;
  }

  CompareRow Row(const std::string& method) const {
    CompareRow row;
    row.method = method;
    row.wall_s = 1e-3 * watch.Milliseconds();
    row.cpu_s = ProcessCpuSeconds() - cpu_start_s;
    return row;
  }
  CompareRow Row(const std::string& method, const PairwiseSequenceResult& result) const {
    CompareRow row = Row(method);
    row.good = result.good;
    row.reason = result.reason;
    if (result.good) row.poses = result.poses;
    return row;
  }
};

Points UsablePoints(const ScanSource& scans, const ScanPreparationOptions& options, std::size_t i) {
  constexpr double kPeriodS = 0.1;  // of no account: the scanner stands still
  Points points;
  for (const TimedPoint& p :
       PrepareScan(scans.Read(i), options, kPeriodS, scans.T_vehicle_lidar(i)).points) {
    points.emplace_back(p.x, p.y, p.z);
  }
  return points;
}

void RunPairwiseJob(const CompareJob& job, const CompareInput& input,
                    const std::function<void()>& progress,
                    const std::function<void(CompareRow)>& on_row) {
  const std::string base = BaseName(job.front());
  const auto& names = PairwiseNames();
  const auto kind =
      static_cast<PairwiseKind>(std::find(names.begin(), names.end(), base) - names.begin());
  std::vector<Points> scans;
  for (std::size_t i = 0; i < input.scans->size(); ++i) {
    scans.push_back(UsablePoints(*input.scans, input.config.lamina.preparation, i));
  }
  const Charge charge;
  std::string fault;
  PairwiseOptions options = input.config.pairwise;
  if (options.feature_voxel_m == 0.0) options.feature_voxel_m = FeatureVoxel(scans);
  const auto method = MakePairwiseMethod(kind, options);
  const std::vector<PairwiseCloud> clouds = PrepareClouds(*method, options, scans, &fault);
  const auto offer = [&](const std::string& name, const PairwiseSequenceResult& result) {
    if (Contains(job, name)) on_row(charge.Row(name, result));
  };
  if (!fault.empty()) {
    for (const std::string& name : job) offer(name, {false, fault, {}});
  } else if (IsGlobal(kind)) {
    const auto on_chain = [&](const PairwiseSequenceResult& chain) { offer(base, chain); };
    offer(kSynchronised + base,
          RegisterGlobally(*method, clouds, input.config.synchronisation, progress, on_chain)
              .synchronised);
  } else {
    const PairwiseSequenceResult chain =
        FrameToFrame(*method, options, clouds, input.initial, progress);
    offer(kFrameToFrame + base, chain);
    if (Contains(job, kFrameToMap + base)) {
      offer(kFrameToMap + base, FrameToMap(*method, options, clouds, chain, progress));
    }
  }
}

// Clusters of each scan; throws InputError for one that cannot be used: a table over some of the
// scans would not be the table of the sequence.
std::vector<BatchFrame> ReadFrames(const CompareInput& input, const Formulation& formulation,
                                   const std::function<void()>& progress, Charge* charge) {
  const double leaf_m = input.config.lamina.map.LeafSize();
  std::vector<BatchFrame> frames;
  for (std::size_t i = 0; i < input.scans->size(); ++i) {
    std::vector<TimedPoint> points;
    charge->Outside([&] {
      Points usable = UsablePoints(*input.scans, input.config.lamina.preparation, i);
      if (input.resolution_m > 0.0) usable = Downsample(usable, input.resolution_m);
      for (const Eigen::Vector3f& p : usable) points.push_back({p.x(), p.y(), p.z(), 0.0F});
    });
    if (points.size() < static_cast<std::size_t>(input.config.lamina.pipeline.min_points)) {
      throw InputError(fmt::format("scan {}: {} usable points, at least {} are wanted", i,
                                   points.size(), input.config.lamina.pipeline.min_points));
    }
    BatchFrame frame;
    frame.stamp_ns = input.scans->Stamp(i);
    frame.T_world_lidar = input.initial.at(i);
    frame.clusters = BuildScanClusters(points, leaf_m);
    if (formulation.needs_points) frame.points = GroupByCluster(points, leaf_m);
    frames.push_back(std::move(frame));
    progress();
  }
  return frames;
}

void RunBundleJob(const std::string& name, CompareInput input,
                  const std::function<void()>& progress,
                  const std::function<void(CompareRow)>& on_row) {
  const Formulation& formulation = FindFormulation(name);
  RegistrationOptions& options = input.config.lamina.registration;
  if (formulation.converges_slowly) options.solver.max_iterations *= 4;
  if (input.max_iterations > 0) options.solver.max_iterations = input.max_iterations;
  Charge charge;
  const std::vector<BatchFrame> frames = ReadFrames(input, formulation, progress, &charge);
  const BatchRegistration registration(options, input.config.lamina.map,
                                       input.config.lamina.backend.window, formulation);
  const RegistrationResult result = registration.Run(frames, {});
  CompareRow row = charge.Row(name);
  using Status = RegistrationResult::Status;
  row.good = result.status != Status::kIllPosed && result.status != Status::kFailed;
  row.reason = result.reason;
  for (const BundleFault& fault : result.faults) {
    // A frame of which nothing was determined stands where it began: that is no result of a method.
    if (fault.kind == BundleFault::Kind::kLeapt ||
        fault.kind == BundleFault::Kind::kOpenDirection) {
      continue;
    }
    row.good = false;
    row.reason = fault.Describe();
  }
  if (row.good) row.poses = result.poses;
  for (const RoundReport& round : result.rounds) {
    row.solve_s += 1e-3 * round.solve_ms;
    row.iterations += round.iterations;
    row.planes = round.planes;
  }
  row.rounds = static_cast<int>(result.rounds.size());
  on_row(std::move(row));
}

void AddPairwise(CompareGroup group, const std::string& prefix, const std::string& form,
                 std::vector<CompareMethod>* methods) {
  static const std::vector<std::array<std::string, 3>> kLocal = {
      {"icp_point", "ICP point to point", "Besl and McKay 1992; PCL"},
      {"icp_plane", "ICP point to plane", "Chen and Medioni 1992; PCL"},
      {"gicp", "GICP", "Segal et al. 2009; PCL"},
      {"ndt", "NDT", "Magnusson 2009; PCL"},
      {"vgicp", "VGICP", "Koide et al. 2021"}};
  for (const auto& [name, title, source] : kLocal) {
    methods->push_back({prefix + name, group, title + form, source});
  }
}

std::vector<CompareMethod> MakeMethods() {
  std::vector<CompareMethod> methods;
  AddPairwise(CompareGroup::kFrameToFrame, kFrameToFrame, ", F2F", &methods);
  AddPairwise(CompareGroup::kFrameToMap, kFrameToMap, ", F2M", &methods);
  const auto add = [&](const char* name, CompareGroup group, const char* title,
                       const char* source) {
    methods.push_back({name, group, title, source});
  };
  add("teaser", CompareGroup::kGlobal, "TEASER++", "Yang et al. 2020");
  add("fgr", CompareGroup::kGlobal, "FGR", "Zhou et al. 2016");
  add("sync_teaser", CompareGroup::kSynchronised, "TEASER++, pose graph", "Yang et al. 2020");
  add("sync_fgr", CompareGroup::kSynchronised, "FGR, pose graph", "Zhou et al. 2016");
  // Lamina's own last.
  for (auto f = Formulations().rbegin(); f != Formulations().rend(); ++f) {
    methods.push_back({(*f)->name, CompareGroup::kBundle,
                       fmt::format("{} ({})", (*f)->title, (*f)->name), (*f)->source});
  }
  return methods;
}

}  // namespace

const std::vector<CompareMethod>& CompareMethods() {
  static const std::vector<CompareMethod> methods = MakeMethods();
  return methods;
}

const CompareMethod& FindMethod(const std::string& name) {
  for (const CompareMethod& method : CompareMethods()) {
    if (method.name == name) return method;
  }
  throw std::logic_error("there is no method " + name);
}

std::string ToString(CompareGroup group) {
  switch (group) {
    case CompareGroup::kFrameToFrame:
      return "frame to frame";
    case CompareGroup::kFrameToMap:
      return "frame to map";
    case CompareGroup::kGlobal:
      return "global";
    case CompareGroup::kSynchronised:
      return "global, synchronised";
    case CompareGroup::kBundle:
      return "bundle adjustment";
  }
  return "unknown";
}

std::vector<std::string> ParseMethods(const std::string& text) {
  std::vector<std::string> wanted, known;
  std::istringstream words(text);
  for (std::string word; std::getline(words, word, ',');) wanted.push_back(word);
  const bool all = text == "all";
  std::vector<std::string> methods;
  std::vector<bool> used(wanted.size());
  for (const CompareMethod& method : CompareMethods()) {
    known.push_back(method.name);
    bool named = all;
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      const bool both_forms = method.group <= CompareGroup::kFrameToMap &&
                              method.name.substr(std::string(kFrameToMap).size()) == wanted[i];
      if (wanted[i] == method.name || both_forms) named = used[i] = true;
    }
    if (named) methods.push_back(method.name);
  }
  for (std::size_t i = 0; i < wanted.size() && !all; ++i) {
    if (!used[i]) {
      throw OptionError(
          fmt::format("--methods {}: must be all, or of {}", wanted[i], fmt::join(known, ", ")));
    }
  }
  if (methods.empty()) throw OptionError("--methods: names no method");
  return methods;
}

std::vector<CompareJob> GroupIntoJobs(const std::vector<std::string>& methods) {
  std::vector<CompareJob> jobs;
  for (const std::string& method : methods) {
    const auto shares = [&](const CompareJob& job) {
      return BaseName(job.front()) == BaseName(method);
    };
    const auto found = std::find_if(jobs.begin(), jobs.end(), shares);
    if (found == jobs.end()) {
      jobs.push_back({method});
    } else {
      found->push_back(method);
    }
  }
  return jobs;
}

void RunCompareJob(const CompareJob& job, const CompareInput& input,
                   const std::function<void()>& progress,
                   const std::function<void(CompareRow)>& on_row) {
  if (FindMethod(job.front()).group == CompareGroup::kBundle) {
    RunBundleJob(job.front(), input, progress, on_row);
  } else {
    RunPairwiseJob(job, input, progress, on_row);
  }
}

}  // namespace lamina
