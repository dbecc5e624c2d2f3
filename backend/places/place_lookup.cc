#include "backend/places/place_lookup.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>
#include <unsupported/Eigen/FFT>

#include "core/base/median.h"
#include "core/base/parallel.h"

namespace lamina {
namespace {

constexpr int kPeaks = 3;

// Angles (in steps of pi / PlaceImage::kAngles) by which the query must be turned to look like the
// other, best first, and how alike the two are then.
struct Likeness {
  std::size_t other = 0;
  float value = 0.0F;
  std::vector<int> angles;
};

Likeness Compare(const PlaceImage& query, const PlaceImage& other) {
  thread_local Eigen::FFT<float> fft;
  std::vector<std::complex<float>> product(PlaceImage::kAngles), along;
  constexpr int kHalf = PlaceImage::kAngles / 2;
  for (int r = 0; r < PlaceImage::kRadii; ++r) {
    for (int k = 1; k < kHalf; ++k) {
      const auto i = static_cast<std::size_t>(r * kHalf + k);
      product[static_cast<std::size_t>(k)] += other.polar[i] * std::conj(query.polar[i]);
    }
  }
  for (int k = 1; k < kHalf; ++k)
    product[static_cast<std::size_t>(PlaceImage::kAngles - k)] =
        std::conj(product[static_cast<std::size_t>(k)]);
  fft.inv(along, product);
  std::vector<float> value(PlaceImage::kAngles);
  for (std::size_t a = 0; a < PlaceImage::kAngles; ++a)
    value[a] = PlaceImage::kAngles * along[a].real();
  Likeness likeness;
  for (int a = 0; a < PlaceImage::kAngles; ++a) {
    const auto at = [&](int i) {
      return value[static_cast<std::size_t>((i + PlaceImage::kAngles) % PlaceImage::kAngles)];
    };
    if (at(a) > at(a - 1) && at(a) >= at(a + 1)) likeness.angles.push_back(a);
  }
  std::stable_sort(likeness.angles.begin(), likeness.angles.end(), [&](int a, int b) {
    return value[static_cast<std::size_t>(a)] > value[static_cast<std::size_t>(b)];
  });
  if (likeness.angles.size() > kPeaks) likeness.angles.resize(kPeaks);
  if (!likeness.angles.empty())
    likeness.value = value[static_cast<std::size_t>(likeness.angles.front())];
  return likeness;
}

float Norm(const PlaceImage& image) {
  float square = 0.0F;
  for (const PlaceImage::Cell& cell : image.cells)
    square += static_cast<float>(cell.bins) * static_cast<float>(cell.bins);
  return std::sqrt(square);
}

struct Shift {
  double x = 0.0, y = 0.0;  // cells
  float value = 0.0F;
};

// Of the turned query on to the other.
Shift BestShift(const ImageSpectrum& turned, const ImageSpectrum& other) {
  ImageSpectrum product(turned.size());
  for (std::size_t i = 0; i < product.size(); ++i) product[i] = other[i] * std::conj(turned[i]);
  Transform(&product, true);
  const auto at = [&](int row, int column) {
    return product[static_cast<std::size_t>(((row + PlaceImage::kCells) % PlaceImage::kCells) *
                                                PlaceImage::kCells +
                                            (column + PlaceImage::kCells) % PlaceImage::kCells)]
        .real();
  };
  int best = 0;
  for (int i = 1; i < PlaceImage::kCells * PlaceImage::kCells; ++i) {
    if (product[static_cast<std::size_t>(i)].real() >
        product[static_cast<std::size_t>(best)].real())
      best = i;
  }
  const int row = best / PlaceImage::kCells, column = best % PlaceImage::kCells;
  // The vertex of the parabola through three neighbours.
  const auto between = [](float before, float middle, float after) {
    const float bend = before - 2 * middle + after;
    return bend < 0.0F ? 0.5 * static_cast<double>((before - after) / bend) : 0.0;
  };
  const auto centred = [](int i) {
    return i >= PlaceImage::kCells / 2 ? i - PlaceImage::kCells : i;
  };
  return {centred(column) + between(at(row, column - 1), at(row, column), at(row, column + 1)),
          centred(row) + between(at(row - 1, column), at(row, column), at(row + 1, column)),
          at(row, column)};
}

// Height of the query's origin above the other's, from the ground in cells that both have.
double GroundStep(const PlaceImage& query, const PlaceImage& other, double yaw,
                  const Shift& shift) {
  std::map<std::pair<int, int>, float> heights;
  for (const PlaceImage::Ground& g : other.ground) heights[{g.x, g.y}] = g.height_m;
  const double c = std::cos(yaw), s = std::sin(yaw);
  std::vector<double> steps;
  for (const PlaceImage::Ground& g : query.ground) {
    const double x = g.x + 0.5, y = g.y + 0.5;
    const auto found = heights.find({static_cast<int>(std::floor(c * x - s * y + shift.x)),
                                     static_cast<int>(std::floor(s * x + c * y + shift.y))});
    if (found != heights.end()) steps.push_back(static_cast<double>(found->second - g.height_m));
  }
  return steps.empty() ? 0.0 : Median(steps);
}

}  // namespace

std::vector<PlaceHypothesis> LookUpPlace(const PlaceImage& query,
                                         const std::vector<const PlaceImage*>& others,
                                         const PlaceOptions& options) {
  std::vector<Likeness> alike(others.size());
  ParallelChunks(others.size(), 32, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      alike[i] = Compare(query, *others[i]);
      alike[i].other = i;
    }
  });
  std::stable_sort(alike.begin(), alike.end(),
                   [](const Likeness& a, const Likeness& b) { return a.value > b.value; });
  if (alike.size() > static_cast<std::size_t>(options.candidates))
    alike.resize(static_cast<std::size_t>(options.candidates));

  // Turned queries serve several of the others.
  std::map<int, ImageSpectrum> turned;
  for (const Likeness& likeness : alike) {
    for (const int a : likeness.angles) turned[a], turned[a + PlaceImage::kAngles];
  }
  std::vector<std::pair<int, ImageSpectrum*>> turns;
  for (auto& [angle, spectrum] : turned) turns.emplace_back(angle, &spectrum);
  ParallelChunks(turns.size(), 1, [&](std::size_t i, std::size_t) {
    *turns[i].second = TurnedSpectrum(query, M_PI * turns[i].first / PlaceImage::kAngles);
  });

  const float query_norm = Norm(query);
  std::vector<std::vector<PlaceHypothesis>> found(alike.size());
  ParallelChunks(alike.size(), 1, [&](std::size_t i, std::size_t) {
    const PlaceImage& other = *others[alike[i].other];
    const ImageSpectrum spectrum = TurnedSpectrum(other, 0.0);
    const float norm = query_norm * Norm(other);
    if (!(norm > 0.0F)) return;
    for (const int a : alike[i].angles) {
      for (const int angle : {a, a + PlaceImage::kAngles}) {
        const double yaw = M_PI * angle / PlaceImage::kAngles;
        const Shift shift = BestShift(turned.at(angle), spectrum);
        SE3 T_level(Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ())),
                    {options.cell_size_m * shift.x, options.cell_size_m * shift.y,
                     GroundStep(query, other, yaw, shift)});
        found[i].push_back({alike[i].other,
                            other.T_level_submap.Inverse() * T_level * query.T_level_submap,
                            static_cast<double>(shift.value / norm)});
      }
    }
    std::stable_sort(found[i].begin(), found[i].end(),
                     [](const auto& p, const auto& q) { return p.score > q.score; });
    if (found[i].size() > 2) found[i].resize(2);
  });
  std::vector<PlaceHypothesis> all;
  for (const auto& some : found) all.insert(all.end(), some.begin(), some.end());
  std::stable_sort(all.begin(), all.end(),
                   [](const auto& p, const auto& q) { return p.score > q.score; });
  return all;
}

}  // namespace lamina
