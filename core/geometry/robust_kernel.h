// The robust kernel of matching and of bundle adjustment.
#pragma once

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

}  // namespace lamina
