// Whether the covariances that matches report are consistent with their errors.
//
// The motion between two scans that are both tracked, D = T_k-1^-1 T_k, is compared with the true
// one: e = LocalDelta(T_k-1 D_true, T_k), with the covariance C = J C_k-1 J' + C_k, J the
// derivative of T_k-1 D_true by T_k-1; both matches are taken for independent. The normalised
// error squared e' C^-1 e (NEES; Bar-Shalom et al., 2001, 5.4.2) has mean 6 if C is right. Along
// the direction in which errors exceed C most their size is `worst_ratio` times the reported sigma:
// the root of the largest eigenvalue of the mean of C^-1/2 e e' C^-1/2.
#pragma once

#include <vector>

#include "tools/promises/judge.h"

namespace lamina {

struct CovarianceCheck {
  std::size_t pairs = 0;      // 0: the others are NaN
  double nees_per_dof = 0.0;  // 1 is right, more: too sure
  double worst_ratio = 0.0;
};

CovarianceCheck CheckCovariance(const std::vector<TrialFrame>& frames);

}  // namespace lamina
