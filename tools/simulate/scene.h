// Virtual scenes on which formulations of bundle adjustment are compared: poses, planes, the points
// that the poses see of the planes, and start values that are wrong by a known amount.
//
// Two generators draw poses and planes. Points are drawn in the same way by both: uniform over the
// square patch of the plane, anew for each pose, with Gaussian noise along the plane's normal, and
// brought to the LiDAR frame by the true pose. Associations are given.
//
//   ferrer   Ferrer, "Eigen-Factors", IROS 2019, as used by Huang et al., RA-L 2021: the last pose
//            is drawn (each angle in [-pi, pi), position within +-kFerrerCubeM) and the poses lie
//            on the SE(3) geodesic from the identity to it; planes with each angle in [-pi, pi),
//            position within +-kFerrerCubeM. Patches of kFerrerPatchM.
//   balm2    the virtual benchmark of BALM 2 (Liu et al., 2022): rotations up to 0.5 rad about any
//            axis, translations up to 1 m in any direction, planes of 1 m within +-2 m, any normal.
//
// A scene is a function of its options and seed alone: each part (a pose, a plane, the points of a
// plane in a pose) has a stream of numbers of its own, so that threads have no say in it, and a
// change of noise or start error leaves all else as it was.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "backend/bundle/problem.h"
#include "core/geometry/se3.h"

namespace lamina {

enum class SceneGenerator { kFerrer, kBalm2 };
// Their names, in the order of the enumeration.
const std::vector<std::string>& SceneGeneratorNames();

inline constexpr double kFerrerCubeM = 5.0;
inline constexpr double kFerrerPatchM = 2.0;
inline constexpr double kBalm2CubeM = 2.0;
inline constexpr double kBalm2PatchM = 1.0;
inline constexpr double kBalm2RotationRad = 0.5;
inline constexpr double kBalm2TranslationM = 1.0;

struct SimulationOptions {
  SceneGenerator generator = SceneGenerator::kFerrer;
  int poses = 20;
  int planes = 20;
  int points = 40;          // of a plane in a pose
  double noise_m = 0.01;    // standard deviation along the normal
  double start_deg = 2.0;   // each pose after the first is turned by exactly this, about any axis,
  double start_m = 0.1;     // and moved by exactly this, in any direction
  double visibility = 1.0;  // chance that a pose sees a plane; at least two see each

  // Throws OptionError, naming the option of the command line, its value, and its rule.
  void Check() const;
};

struct PlanePatch {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();  // columns: two directions in it, its normal
  double side_m = 1.0;
};

struct SimulatedScene {
  std::vector<SE3> truth;  // T_world_lidar; the first is the identity
  std::vector<PlanePatch> patches;
  // Starts the first pose at the truth and holds it. Weights are 1 / noise^2; 1 without noise.
  BundleProblem problem;
};

// `keep_points`: fill BundleProblem::points, for evm1. Parallel over planes; the same bits at any
// number of threads.
SimulatedScene MakeSimulatedScene(const SimulationOptions& options, std::uint64_t seed,
                                  bool keep_points);

}  // namespace lamina
