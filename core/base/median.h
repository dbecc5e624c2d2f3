// Medians and other quantiles.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

namespace lamina {

// The value at place share * n, rounded down, of n sorted ones (the last one at most), in O(n): one
// of the values. There must be one at least; they are reordered.
template <typename T>
T Quantile(std::vector<T>* values, double share) {
  const std::size_t place = std::min(
      values->size() - 1, static_cast<std::size_t>(share * static_cast<double>(values->size())));
  const auto at = values->begin() + static_cast<std::ptrdiff_t>(place);
  std::nth_element(values->begin(), at, values->end());
  return *at;
}

// The one at place n / 2: the upper one of the two in the middle where n is even.
template <typename T>
T UpperMedian(std::vector<T>* values) {
  return Quantile(values, 0.5);
}

// The mean of the two values in the middle where n is even; NaN if there are none.
inline double Median(std::vector<double> values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const double high = UpperMedian(&values);
  if (values.size() % 2 == 1) return high;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  const double low = *std::max_element(values.begin(), middle);
  // Both may be infinite.
  return low == high ? low : 0.5 * (low + high);
}

}  // namespace lamina
