// Bundle adjustment with two unknowns a beam, point by point: how far each beam's elevation and
// range are off.
//
// A point p of beam b, frame k, on a plane with normal n, has the residual and derivatives
//
//     r = n . (T_k D(tau) p - centre),      D(tau) the sensor's motion since the frame's stamp
//     dr/d[w_k; v_k]  =  [q x R_k'n; n],    q = D(tau) p
//     dr/d[e_b; r_b]  =  f(p)' R_D' R_k' n, f the fields of sensor_intrinsics.h at p
//     dr/dplane       =  [1, x.u1, x.u2]    shift and tilts, x from the plane's centre
//
// Clusters do not do here: a cluster holds points of several beams. Planes are eliminated one by
// one, then the poses of the segment; what is left is a dense system of two unknowns a beam, and
// those of several segments add.
//
// Private to backend/calibration.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/geometry/se3.h"

namespace lamina {

// A point's row of the system.
struct BeamRow {
  std::int32_t plane = 0, frame = 0, beam = 0;
  double residual = 0.0, weight = 0.0;
  Vector6d by_pose = Vector6d::Zero();
  Eigen::Vector2d by_beam = Eigen::Vector2d::Zero();
  Eigen::Vector3d by_plane = Eigen::Vector3d::Zero();
};

// cost + g'd + 1/2 d'H d for a change d = [e_0, r_0, e_1, r_1, ...] of the beams, planes and poses
// following; these by pose_step + pose_slope d.
struct ReducedBeamSystem {
  Eigen::MatrixXd H;
  Eigen::VectorXd g;
  Eigen::VectorXd pose_step;
  Eigen::MatrixXd pose_slope;
};

class BeamSystem {
 public:
  BeamSystem(std::size_t frames, std::size_t beams);

  // The rows [begin, end) of one plane.
  void AddPlane(const BeamRow* begin, const BeamRow* end);
  // The first pose is held; the others are by a weak prior, so that one without planes can be
  // solved for.
  ReducedBeamSystem Reduce() const;

 private:
  Eigen::Index PlaceOfFrame(std::int32_t frame) const { return 6 * frame; }
  Eigen::Index PlaceOfBeam(std::int32_t beam) const { return 6 * frames_ + 2 * beam; }

  Eigen::Index frames_, beams_;
  Eigen::MatrixXd H_;  // of poses, then beams; lower triangle
  Eigen::VectorXd g_;
};

}  // namespace lamina
