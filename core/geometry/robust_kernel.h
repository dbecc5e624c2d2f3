// The robust kernel of matching and of bundle adjustment, and the cost of unlikely motions.
#pragma once

#include <cmath>

namespace lamina {

// Weight of a residual under the kernel of Geman and McClure ("Statistical methods for tomographic
// image reconstruction", 1987), with e the residual in units of the kernel's scale:
//
//     rho(e) = 1/2 e^2 / (1 + e^2),    weight = rho'(e) / e = 1 / (1 + e^2)^2    in (0, 1]
//
// It redescends: beyond e = 1 / sqrt(3) a residual pulls less the farther off it is, so what moves
// or belongs elsewhere is let go. Takes e^2.
inline double GemanMcClureWeight(double e2) { return 1.0 / ((1.0 + e2) * (1.0 + e2)); }

// 1 - 2 rho(e), in (0, 1]: how well what is so far off fits. Its square is the weight.
inline double GemanMcClureFit(double e2) { return 1.0 / (1.0 + e2); }

// U = 2 log(1 + s^2): -2 log of Cauchy's density, up to a constant, where a normal one has s^2.
// What s standard deviations cost if now and then there are many, as of changes of a sensor's
// motion. Takes s^2.
inline double CauchyCost(double s2) { return 2.0 * std::log1p(s2); }

}  // namespace lamina
