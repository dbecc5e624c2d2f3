#include "backend/bundle/plane_choice.h"

#include <algorithm>
#include <cstddef>

#include "core/base/median.h"

namespace lamina {

void KeepBinding(int most, std::vector<Plane>* planes) {
  planes->erase(std::remove_if(planes->begin(), planes->end(),
                               [](const Plane& p) { return p.count < 2 && p.fixed.Empty(); }),
                planes->end());
  if (planes->size() <= static_cast<std::size_t>(most)) return;
  std::stable_sort(planes->begin(), planes->end(),
                   [](const Plane& a, const Plane& b) { return a.count > b.count; });
  planes->resize(static_cast<std::size_t>(most));
}

void DistrustThick(std::vector<Plane>* planes) {
  if (planes->empty()) return;
  constexpr double kUsual = 0.75, kMost = 2.5;
  std::vector<double> weights;
  weights.reserve(planes->size());
  for (const Plane& plane : *planes) weights.push_back(plane.weight);
  const double usual = Quantile(&weights, 1.0 - kUsual);
  for (Plane& plane : *planes) {
    const double excess = std::max(1.0, usual / (kMost * plane.weight));
    plane.weight /= excess * excess * excess * excess;
  }
}

}  // namespace lamina
