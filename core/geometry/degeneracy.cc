#include "core/geometry/degeneracy.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

namespace lamina {

double WorstSigmaM(const Matrix6d& covariance) {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(TimesArm(covariance),
                                                       Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, solver.eigenvalues()(5)));
}

double NormalError2(double variance, double breadth2, double beam2) {
  return kLeastNormalError * kLeastNormalError +
         (std::max(0.0, variance) + beam2) / std::max(kLeastBreadth2, breadth2);
}

void DirectionEvidence::Add(const Vector6d& j, double weight, double normal_error2,
                            double rotation_arm, double translation_arm) {
  const double rotation2 = normal_error2 * rotation_arm * rotation_arm;
  const double translation2 = normal_error2 * translation_arm * translation_arm;
  const Vector6d along = directions.transpose() * j;
  const Vector6d turned = directions.topRows<3>().colwise().squaredNorm().transpose();
  // The directions are unit vectors.
  const Vector6d leak2 = Vector6d::Constant(translation2) + (rotation2 - translation2) * turned;
  const Vector6d i = weight * (along.cwiseAbs2() - leak2).cwiseMax(0.0);
  information += i;
  squares += i.cwiseAbs2();
}

double DirectionEvidence::Sigma(int k) const {
  return information(k) > 0.0 ? 1.0 / std::sqrt(information(k))
                              : std::numeric_limits<double>::infinity();
}

}  // namespace lamina
