#include "tools/simulate/scene.h"

#include <fmt/format.h>

#include <cmath>

#include "core/base/angle.h"
#include "core/base/error.h"
#include "core/base/parallel.h"
#include "tools/synth/engine/random.h"

namespace lamina {
namespace {

constexpr double kPi = 3.14159265358979323846;

// What a stream of numbers is for; part of its key.
enum StreamKind { kPoseStream = 1, kPlaneStream, kSeenStream, kPointStream, kStartStream };

// Random numbers that depend on the scene's seed and on what they are for.
class Stream {
 public:
  Stream(std::uint64_t seed, StreamKind kind, std::size_t a = 0, std::size_t b = 0)
      : numbers_(synth::HashOf({static_cast<std::int64_t>(seed), kind, static_cast<std::int64_t>(a),
                                static_cast<std::int64_t>(b)})) {}

  double Uniform(double low, double high) { return numbers_.Uniform(low, high); }
  bool Chance(double probability) { return numbers_.Chance(probability); }
  int Index(int count) { return numbers_.Index(count); }
  // Standard normal by Box and Muller: written out, since the standard library's own differs from
  // one to the next.
  double Normal() {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - numbers_.Uniform()));
    return radius * std::cos(2.0 * kPi * numbers_.Uniform());
  }
  Eigen::Vector3d InCube(double half) {
    const double x = Uniform(-half, half), y = Uniform(-half, half);
    return {x, y, Uniform(-half, half)};
  }
  // Uniform over the sphere.
  Eigen::Vector3d Direction() {
    const double z = Uniform(-1.0, 1.0), angle = Uniform(-kPi, kPi);
    const double r = std::sqrt(1.0 - z * z);
    return {r * std::cos(angle), r * std::sin(angle), z};
  }
  Eigen::Quaterniond ByAngles() {
    const double roll = Uniform(-kPi, kPi), pitch = Uniform(-kPi, kPi), yaw = Uniform(-kPi, kPi);
    return ExpSO3({0.0, 0.0, yaw}) * ExpSO3({0.0, pitch, 0.0}) * ExpSO3({roll, 0.0, 0.0});
  }

 private:
  synth::HashStream numbers_;
};

std::vector<SE3> FerrerPoses(const SimulationOptions& options, std::uint64_t seed) {
  Stream stream(seed, kPoseStream);
  const Eigen::Quaterniond q = stream.ByAngles();
  const SE3 last(q, stream.InCube(kFerrerCubeM));
  std::vector<SE3> poses;
  for (int k = 0; k < options.poses; ++k) {
    poses.push_back(Interpolate(SE3(), last, static_cast<double>(k) / (options.poses - 1)));
  }
  return poses;
}

std::vector<SE3> Balm2Poses(const SimulationOptions& options, std::uint64_t seed) {
  std::vector<SE3> poses{SE3()};
  for (std::size_t k = 1; k < static_cast<std::size_t>(options.poses); ++k) {
    Stream stream(seed, kPoseStream, k);
    const Eigen::Vector3d axis = stream.Direction(), way = stream.Direction();
    const double angle = stream.Uniform(0.0, kBalm2RotationRad);
    poses.emplace_back(ExpSO3(angle * axis), stream.Uniform(0.0, kBalm2TranslationM) * way);
  }
  return poses;
}

PlanePatch MakePatch(SceneGenerator generator, std::uint64_t seed, std::size_t plane) {
  Stream stream(seed, kPlaneStream, plane);
  PlanePatch patch;
  if (generator == SceneGenerator::kFerrer) {
    patch.axes = stream.ByAngles().toRotationMatrix();
    patch.centre = stream.InCube(kFerrerCubeM);
    patch.side_m = kFerrerPatchM;
  } else {
    const Eigen::Vector3d normal = stream.Direction();
    // Turned about its normal by any angle, too: no corner of a patch has a favourite direction.
    patch.axes = (Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), normal) *
                  ExpSO3({0.0, 0.0, stream.Uniform(-kPi, kPi)}))
                     .toRotationMatrix();
    patch.centre = stream.InCube(kBalm2CubeM);
    patch.side_m = kBalm2PatchM;
  }
  return patch;
}

// Which poses see the plane, ascending.
std::vector<int> PosesThatSee(const SimulationOptions& options, std::uint64_t seed,
                              std::size_t plane) {
  Stream stream(seed, kSeenStream, plane);
  std::vector<bool> seen;
  int count = 0;
  for (int k = 0; k < options.poses; ++k) {
    seen.push_back(stream.Chance(options.visibility));
    count += seen.back() ? 1 : 0;
  }
  // A plane that one pose alone sees says nothing about any pose.
  while (count < 2) {
    const auto k = static_cast<std::size_t>(stream.Index(options.poses));
    count += seen[k] ? 0 : 1;
    seen[k] = true;
  }
  std::vector<int> poses;
  for (int k = 0; k < options.poses; ++k) {
    if (seen[static_cast<std::size_t>(k)]) poses.push_back(k);
  }
  return poses;
}

struct SeenPlane {
  PlanePatch patch;
  std::vector<PlaneObservation> observations;
  std::vector<std::vector<WeightedPoint>> points;  // of each observation, if kept
};

void SeePlane(const SimulationOptions& options, std::uint64_t seed, std::size_t plane,
              const std::vector<SE3>& truth, bool keep_points, SeenPlane* seen) {
  seen->patch = MakePatch(options.generator, seed, plane);
  const double half = 0.5 * seen->patch.side_m;
  for (const int k : PosesThatSee(options, seed, plane)) {
    const SE3 T_lidar_world = truth[static_cast<std::size_t>(k)].Inverse();
    Stream stream(seed, kPointStream, plane, static_cast<std::size_t>(k));
    PlaneObservation observation{k, {}};
    std::vector<WeightedPoint> points;
    for (int i = 0; i < options.points; ++i) {
      const double x = stream.Uniform(-half, half), y = stream.Uniform(-half, half);
      const Eigen::Vector3d local(x, y, options.noise_m * stream.Normal());
      const Eigen::Vector3d p = T_lidar_world * (seen->patch.centre + seen->patch.axes * local);
      observation.cluster.AddPoint(p);
      if (keep_points) points.push_back({p, 1.0});
    }
    seen->observations.push_back(observation);
    if (keep_points) seen->points.push_back(std::move(points));
  }
}

std::vector<SE3> StartPoses(const SimulationOptions& options, std::uint64_t seed,
                            const std::vector<SE3>& truth) {
  std::vector<SE3> poses{truth[0]};
  for (std::size_t k = 1; k < truth.size(); ++k) {
    Stream stream(seed, kStartStream, k);
    const Eigen::Vector3d axis = stream.Direction(), way = stream.Direction();
    poses.emplace_back(truth[k].q * ExpSO3(options.start_deg * kDegree * axis),
                       truth[k].t + options.start_m * way);
  }
  return poses;
}

void RequireInteger(const char* option, int value, int low, int high) {
  if (value >= low && value <= high) return;
  throw OptionError(fmt::format("{} = {}: must be in [{}, {}]", option, value, low, high));
}

void RequireNumber(const char* option, double value, double low, double high) {
  if (value >= low && value <= high) return;  // false for NaN
  throw OptionError(fmt::format("{} = {}: must be in [{}, {}]", option, value, low, high));
}

}  // namespace

const std::vector<std::string>& SceneGeneratorNames() {
  static const std::vector<std::string> names = {"ferrer", "balm2"};
  return names;
}

void SimulationOptions::Check() const {
  RequireInteger("--poses", poses, 2, 2000);
  RequireInteger("--planes", planes, 3, 100000);
  RequireInteger("--points", points, 3, 1000000);
  RequireNumber("--noise-m", noise_m, 0.0, 10.0);
  RequireNumber("--start-deg", start_deg, 0.0, 180.0);
  RequireNumber("--start-m", start_m, 0.0, 1000.0);
  RequireNumber("--visibility", visibility, 0.0, 1.0);
  constexpr std::int64_t kMostClusters = 10000000;  // about 1 GB
  if (std::int64_t{poses} * planes > kMostClusters) {
    throw OptionError(fmt::format("--poses x --planes = {} x {}: must be at most {} clusters",
                                  poses, planes, kMostClusters));
  }
}

SimulatedScene MakeSimulatedScene(const SimulationOptions& options, std::uint64_t seed,
                                  bool keep_points) {
  options.Check();
  SimulatedScene scene;
  scene.truth = options.generator == SceneGenerator::kFerrer ? FerrerPoses(options, seed)
                                                             : Balm2Poses(options, seed);
  scene.problem.poses = StartPoses(options, seed, scene.truth);
  std::vector<SeenPlane> seen(static_cast<std::size_t>(options.planes));
  ParallelChunks(seen.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      SeePlane(options, seed, i, scene.truth, keep_points, &seen[i]);
    }
  });
  BundleProblem& problem = scene.problem;
  for (SeenPlane& s : seen) {
    Plane plane;
    plane.first = static_cast<std::int32_t>(problem.observations.size());
    plane.count = static_cast<std::int32_t>(s.observations.size());
    plane.weight = options.noise_m > 0.0 ? 1.0 / (options.noise_m * options.noise_m) : 1.0;
    problem.planes.push_back(plane);
    problem.observations.insert(problem.observations.end(), s.observations.begin(),
                                s.observations.end());
    for (auto& points : s.points) problem.points.push_back(std::move(points));
    scene.patches.push_back(s.patch);
  }
  return scene;
}

}  // namespace lamina
