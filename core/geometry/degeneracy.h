// Which directions of a pose a set of plane residuals determines: the one criterion of matching, of
// the sliding window and of batches.
//
// Directions are unit vectors v of the *scaled* tangent: that of core/geometry/se3.h with rotations
// counting by what they move at kRotationArmM, so that everything is in metres. A residual with
// scaled Jacobian row j and weight w (1/m^2) carries w (j v)^2 of information along v. Part of it
// may be feigned: a normal that is wrong by the angle a turns the row by up to leak(v),
//
//     leak(v)^2 = a^2 (|mu|^2 / arm^2 |v_rotation|^2 + |v_translation|^2),
//
// mu being the point in the LiDAR frame. What counts is
//
//     i = w max(0, (j v)^2 - leak(v)^2),     information(v) = sum i,
//     facing(v) = (sum i)^2 / sum i^2,       the effective number of residuals that face v.
//
// A direction is degenerate if 1 / sqrt(information) exceeds a standard deviation in metres, or if
// fewer than a number of residuals face it (few may all be wrong). Both are absolute: residuals
// that say nothing of v change nothing about v, however many they are.
#pragma once

#include "core/geometry/se3.h"

namespace lamina {

// Rotations count by what they move at this distance, in metres.
inline constexpr double kRotationArmM = 3.0;

// A gradient or a matrix of information in the scaled tangent.
inline Vector6d DividedByArm(Vector6d v) {
  v.head<3>() /= kRotationArmM;
  return v;
}
inline Matrix6d DividedByArm(Matrix6d m) {
  m.topRows<3>() /= kRotationArmM;
  m.leftCols<3>() /= kRotationArmM;
  return m;
}

// A step or a covariance in the scaled tangent.
inline Vector6d TimesArm(Vector6d v) {
  v.head<3>() *= kRotationArmM;
  return v;
}
inline Matrix6d TimesArm(Matrix6d m) {
  m.topRows<3>() *= kRotationArmM;
  m.leftCols<3>() *= kRotationArmM;
  return m;
}

// The step from one pose to another in the scaled tangent.
inline Vector6d ScaledDelta(const SE3& from, const SE3& to) {
  return TimesArm(LocalDelta(from, to));
}

// Largest standard deviation over all directions of the scaled tangent, metres, of a covariance
// that is not scaled.
double WorstSigmaM(const Matrix6d& covariance);

// A normal matrix (scaled) in which these directions carry that information and nothing else.
inline Matrix6d WithHeld(const Matrix6d& H, const Matrix6d& directions,
                         const Vector6d& information) {
  const Matrix6d keep = Matrix6d::Identity() - directions * directions.transpose();
  return keep * H * keep + directions * information.asDiagonal() * directions.transpose();
}

// Squared angle, rad^2, by which the normal of a plane may be wrong. `variance` and `breadth2` are
// the smallest and the middle eigenvalue of its points, `beam2` the square of what two beams of the
// sensor may disagree by, in range or height, all in m^2:
//
//     0.02^2 + (variance + beam2) / breadth2
//
// The thickness over the breadth stands for steps, foliage or two walls; the beams' error over the
// breadth for the plane through two rings that lie close together, which leans by as much and moves
// along with the sensor.
inline constexpr double kLeastNormalError = 0.02, kLeastBreadth2 = 1e-8;
double NormalError2(double variance, double breadth2, double beam2);

struct DirectionEvidence {
  Matrix6d directions = Matrix6d::Identity();  // columns: the directions, orthonormal
  Vector6d information = Vector6d::Zero();     // 1/m^2
  Vector6d squares = Vector6d::Zero();         // sum of i^2

  // i of a residual of weight `weight` and scaled row j, along each direction. Of the row, rotation
  // and translation are turned by a wrong normal in proportion to rotation_arm
  // (|mu| / kRotationArmM) and translation_arm (1). For many rows: EvidenceSums (match_rows.h).
  void Add(const Vector6d& j, double weight, double normal_error2, double rotation_arm,
           double translation_arm);
  DirectionEvidence& operator+=(const DirectionEvidence& o) {
    information += o.information;
    squares += o.squares;
    return *this;
  }
  double Facing(int k) const {
    return squares(k) > 0.0 ? information(k) * information(k) / squares(k) : 0.0;
  }
  // Infinite where nothing faces the direction.
  double Sigma(int k) const;
  bool Degenerate(int k, double max_sigma_m, double min_facing) const {
    return Sigma(k) > max_sigma_m || Facing(k) < min_facing;
  }
};

}  // namespace lamina
