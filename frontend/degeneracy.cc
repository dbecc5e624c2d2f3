#include "frontend/degeneracy.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lamina {

double NormalError2(double variance, double breadth2, double beam2) {
  constexpr double kLeastError = 0.02, kLeastBreadth2 = 1e-8;
  return kLeastError * kLeastError +
         (std::max(0.0, variance) + beam2) / std::max(kLeastBreadth2, breadth2);
}

void DirectionEvidence::Add(const Vector6d& j, double weight, double normal_error2,
                            double rotation_arm, double translation_arm) {
  const double rotation2 = normal_error2 * rotation_arm * rotation_arm;
  const double translation2 = normal_error2 * translation_arm * translation_arm;
  for (int k = 0; k < 6; ++k) {
    const auto v = directions.col(k);
    const double along = v.dot(j);
    const double leak2 =
        rotation2 * v.head<3>().squaredNorm() + translation2 * v.tail<3>().squaredNorm();
    const double i = weight * std::max(0.0, along * along - leak2);
    information(k) += i;
    squares(k) += i * i;
  }
}

double DirectionEvidence::Sigma(int k) const {
  return information(k) > 0.0 ? 1.0 / std::sqrt(information(k))
                              : std::numeric_limits<double>::infinity();
}

}  // namespace lamina
