#include "backend/calibration/beam_system.h"

#include <Eigen/Cholesky>
#include <algorithm>

#include "core/base/angle.h"

namespace lamina {
namespace {

using BeamPlaneColumns = Eigen::Matrix<double, Eigen::Dynamic, 3>;

std::vector<std::int32_t> Distinct(const BeamRow* begin, const BeamRow* end,
                                   std::int32_t BeamRow::*number) {
  std::vector<std::int32_t> numbers;
  for (const BeamRow* row = begin; row != end; ++row) numbers.push_back(row->*number);
  std::sort(numbers.begin(), numbers.end());
  numbers.erase(std::unique(numbers.begin(), numbers.end()), numbers.end());
  return numbers;
}

Eigen::Index PositionOf(std::int32_t number, const std::vector<std::int32_t>& numbers) {
  return std::lower_bound(numbers.begin(), numbers.end(), number) - numbers.begin();
}

}  // namespace

BeamSystem::BeamSystem(std::size_t frames, std::size_t beams)
    : frames_(static_cast<Eigen::Index>(frames)),
      beams_(static_cast<Eigen::Index>(beams)),
      H_(Eigen::MatrixXd::Zero(6 * frames_ + 2 * beams_, 6 * frames_ + 2 * beams_)),
      g_(Eigen::VectorXd::Zero(6 * frames_ + 2 * beams_)) {}

void BeamSystem::AddPlane(const BeamRow* begin, const BeamRow* end) {
  const std::vector<std::int32_t> frames = Distinct(begin, end, &BeamRow::frame);
  const std::vector<std::int32_t> beams = Distinct(begin, end, &BeamRow::beam);
  const auto of_frames = 6 * static_cast<Eigen::Index>(frames.size());
  std::vector<Eigen::Index> places;  // of the plane's unknowns, in the whole
  for (const std::int32_t f : frames) {
    for (Eigen::Index i = 0; i < 6; ++i) places.push_back(PlaceOfFrame(f) + i);
  }
  for (const std::int32_t b : beams) {
    for (Eigen::Index i = 0; i < 2; ++i) places.push_back(PlaceOfBeam(b) + i);
  }
  BeamPlaneColumns W = BeamPlaneColumns::Zero(static_cast<Eigen::Index>(places.size()), 3);
  Eigen::Matrix3d P = Eigen::Matrix3d::Zero();
  Eigen::Vector3d Pr = Eigen::Vector3d::Zero();
  for (const BeamRow* row = begin; row != end; ++row) {
    const double w = row->weight;
    const Eigen::Index f = PlaceOfFrame(row->frame), b = PlaceOfBeam(row->beam);
    H_.block<6, 6>(f, f) += w * row->by_pose * row->by_pose.transpose();
    H_.block<2, 6>(b, f) += w * row->by_beam * row->by_pose.transpose();
    H_.block<2, 2>(b, b) += w * row->by_beam * row->by_beam.transpose();
    g_.segment<6>(f) += (w * row->residual) * row->by_pose;
    g_.segment<2>(b) += (w * row->residual) * row->by_beam;
    const Eigen::RowVector3d by_plane = w * row->by_plane.transpose();
    W.middleRows<6>(6 * PositionOf(row->frame, frames)) += row->by_pose * by_plane;
    W.middleRows<2>(of_frames + 2 * PositionOf(row->beam, beams)) += row->by_beam * by_plane;
    P += row->by_plane * by_plane;
    Pr += row->residual * by_plane.transpose();
  }
  // So that points in a line can be solved for.
  P.diagonal().array() += 1e-9 * P.trace();
  // (W L^-T)(W L^-T)' = W P^-1 W', with P = L L'.
  const Eigen::LLT<Eigen::Matrix3d> llt(P);
  const BeamPlaneColumns V = llt.matrixL().solve(W.transpose()).transpose();
  const Eigen::Vector3d s = llt.matrixL().solve(Pr);
  for (Eigen::Index i = 0; i < V.rows(); ++i) {
    const Eigen::Index to = places[static_cast<std::size_t>(i)];
    g_(to) -= V.row(i).dot(s);
    for (Eigen::Index j = 0; j <= i; ++j) {
      H_(to, places[static_cast<std::size_t>(j)]) -= V.row(i).dot(V.row(j));
    }
  }
}

ReducedBeamSystem BeamSystem::Reduce() const {
  constexpr double kHeld = 1e12, kPriorM = 0.1;
  const double prior_rad = Radians(0.5);
  const Eigen::Index poses = 6 * frames_, beams = 2 * beams_;
  Eigen::MatrixXd Hpp = H_.topLeftCorner(poses, poses);
  for (Eigen::Index k = 0; k < frames_; ++k) {
    Hpp.diagonal().segment<3>(6 * k).array() += k == 0 ? kHeld : 1.0 / (prior_rad * prior_rad);
    Hpp.diagonal().segment<3>(6 * k + 3).array() += k == 0 ? kHeld : 1.0 / (kPriorM * kPriorM);
  }
  const Eigen::MatrixXd Hbp = H_.bottomLeftCorner(beams, poses);
  const Eigen::LLT<Eigen::MatrixXd> llt(Hpp);  // reads the lower triangle
  ReducedBeamSystem reduced;
  reduced.pose_step = -llt.solve(g_.head(poses));
  reduced.pose_slope = -llt.solve(Hbp.transpose());
  reduced.H = H_.bottomRightCorner(beams, beams).selfadjointView<Eigen::Lower>();
  reduced.H += Hbp * reduced.pose_slope;
  reduced.g = g_.tail(beams) + Hbp * reduced.pose_step;
  return reduced;
}

}  // namespace lamina
