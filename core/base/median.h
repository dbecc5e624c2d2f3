// Medians.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

namespace lamina {

// The value at place n / 2 of n sorted ones, in O(n): one of the values, also where n is even.
// There must be one at least; they are reordered.
template <typename T>
T UpperMedian(std::vector<T>* values) {
  const auto middle = values->begin() + static_cast<std::ptrdiff_t>(values->size() / 2);
  std::nth_element(values->begin(), middle, values->end());
  return *middle;
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
