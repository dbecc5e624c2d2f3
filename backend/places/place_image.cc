#include "backend/places/place_image.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <unsupported/Eigen/FFT>
#include <utility>

namespace lamina {
namespace {

constexpr int kCells = PlaceImage::kCells, kAngles = PlaceImage::kAngles,
              kRadii = PlaceImage::kRadii;

SE3 LevelFrame(const Submap& submap, const Eigen::Vector3d& up) {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const SubmapKeyframe& keyframe : submap.keyframes)
    middle += keyframe.T_submap_lidar.t / static_cast<double>(submap.keyframes.size());
  const Eigen::Quaterniond q = Eigen::Quaterniond::FromTwoVectors(up, Eigen::Vector3d::UnitZ());
  return SE3(q, -(q * middle));
}

using Place = std::pair<std::int8_t, std::int8_t>;

// False outside of the disc.
bool CellOf(const Eigen::Vector3d& p, double cell_m, Place* place) {
  const double x = std::floor(p.x() / cell_m), y = std::floor(p.y() / cell_m);
  if (!(x * x + y * y < PlaceImage::kRadius * PlaceImage::kRadius)) return false;
  *place = {static_cast<std::int8_t>(x), static_cast<std::int8_t>(y)};
  return true;
}

struct Column {
  std::vector<int> bins;
  float ground = std::numeric_limits<float>::infinity();
};

// The magnitude at a frequency, between its four neighbours; frequencies wrap.
float Magnitude(const std::vector<float>& magnitude, double u, double v) {
  const double fu = std::floor(u), fv = std::floor(v);
  const auto au = static_cast<float>(u - fu), av = static_cast<float>(v - fv);
  const auto at = [&](int du, int dv) {
    const int i = (static_cast<int>(fu) + du + kCells) % kCells;
    const int j = (static_cast<int>(fv) + dv + kCells) % kCells;
    return magnitude[static_cast<std::size_t>(i * kCells + j)];
  };
  return (1 - au) * ((1 - av) * at(0, 0) + av * at(0, 1)) +
         au * ((1 - av) * at(1, 0) + av * at(1, 1));
}

std::vector<std::complex<float>> Polar(const PlaceImage& image) {
  const ImageSpectrum spectrum = TurnedSpectrum(image, 0.0);
  std::vector<float> magnitude(spectrum.size());
  std::transform(spectrum.begin(), spectrum.end(), magnitude.begin(),
                 [](std::complex<float> value) { return std::log1p(std::abs(value)); });
  Eigen::FFT<float> fft;
  std::vector<std::complex<float>> polar, along;
  float square = 0.0F;
  for (int r = 0; r < kRadii; ++r) {
    // Slow changes of the image alone: neither cells nor the keyframes' places are the same twice.
    const double radius = 2.0 + 1.5 * r;
    std::vector<std::complex<float>> ring;
    for (int a = 0; a < kAngles; ++a) {
      const double angle = M_PI * a / kAngles;
      // The spectrum is transposed: its rows are frequencies along x of the columns.
      ring.emplace_back(Magnitude(magnitude, radius * std::cos(angle), radius * std::sin(angle)),
                        0.0F);
    }
    fft.fwd(along, ring);
    along[0] = 0.0F;
    for (int k = 0; k < kAngles / 2; ++k) {
      polar.push_back(along[static_cast<std::size_t>(k)]);
      square += std::norm(polar.back());
    }
  }
  const float scale = square > 0.0F ? 1.0F / std::sqrt(2.0F * square) : 0.0F;
  for (std::complex<float>& value : polar) value *= scale;
  return polar;
}

}  // namespace

void PlaceOptions::Visit(OptionVisitor& v) {
  v.Number("cell_size_m", &cell_size_m, 0.05, 10.0);
  v.Integer("candidates", &candidates, 1, 1000);
  v.Number("max_tilt_deg", &max_tilt_deg, 0.0, 60.0);
}

void Transform(ImageSpectrum* image, bool inverse) {
  thread_local Eigen::FFT<float> fft;
  const std::size_t n = kCells;
  ImageSpectrum& f = *image;
  std::array<std::complex<float>, kCells> line;
  const auto rows = [&] {
    for (std::size_t i = 0; i < n; ++i) {
      std::complex<float>* row = f.data() + i * n;
      std::copy(row, row + n, line.begin());
      if (inverse) {
        fft.inv(row, line.data(), kCells);
      } else {
        fft.fwd(row, line.data(), kCells);
      }
    }
  };
  const auto transpose = [&] {
    for (std::size_t i = 0; i < n; ++i) {
      for (std::size_t j = i + 1; j < n; ++j) std::swap(f[i * n + j], f[j * n + i]);
    }
  };
  rows();
  transpose();
  rows();
}

ImageSpectrum TurnedSpectrum(const PlaceImage& image, double yaw) {
  ImageSpectrum spectrum(static_cast<std::size_t>(kCells * kCells));
  const double c = std::cos(yaw), s = std::sin(yaw);
  for (const PlaceImage::Cell& cell : image.cells) {
    const double x = cell.x + 0.5, y = cell.y + 0.5;
    const double tx = c * x - s * y - 0.5, ty = s * x + c * y - 0.5;
    const double fx = std::floor(tx), fy = std::floor(ty);
    const auto ax = static_cast<float>(tx - fx), ay = static_cast<float>(ty - fy);
    // Spread over the four cells around, or turning would let some go empty.
    for (int corner = 0; corner < 4; ++corner) {
      const int dx = corner & 1, dy = corner >> 1;
      const int column = (static_cast<int>(fx) + dx + kCells) % kCells;
      const int row = (static_cast<int>(fy) + dy + kCells) % kCells;
      spectrum[static_cast<std::size_t>(row * kCells + column)] +=
          static_cast<float>(cell.bins) * (dx == 0 ? 1 - ax : ax) * (dy == 0 ? 1 - ay : ay);
    }
  }
  Transform(&spectrum, false);
  return spectrum;
}

PlaceImage MakePlaceImage(const Submap& submap, const std::vector<LeafPlane>& planes,
                          const PlaceOptions& options, const Eigen::Vector3d& expected_up) {
  PlaceImage image;
  const Eigen::Vector3d up = UpOfPlanes(planes, expected_up, options.max_tilt_deg);
  image.T_level_submap = LevelFrame(submap, up);
  std::map<Place, Column> columns;
  Place at;
  for (const LeafPlane& plane : planes) {
    const Eigen::Vector3d p = image.T_level_submap * plane.mean.cast<double>();
    if (!LiesFlat(plane, up) || !CellOf(p, options.cell_size_m, &at)) continue;
    float& ground = columns[at].ground;
    ground = std::min(ground, static_cast<float>(p.z()));
  }
  for (const Eigen::Vector3f& mean : UprightLeaves(submap, planes, up)) {
    const Eigen::Vector3d p = image.T_level_submap * mean.cast<double>();
    if (CellOf(p, options.cell_size_m, &at))
      columns[at].bins.push_back(static_cast<int>(std::floor(p.z() / PlaceImage::kBinM)));
  }
  for (auto& [place, column] : columns) {
    if (std::isfinite(column.ground))
      image.ground.push_back({place.first, place.second, column.ground});
    std::sort(column.bins.begin(), column.bins.end());
    const auto bins = std::unique(column.bins.begin(), column.bins.end()) - column.bins.begin();
    if (bins == 0) continue;
    image.cells.push_back(
        {place.first, place.second,
         static_cast<std::uint8_t>(std::min<std::ptrdiff_t>(bins, PlaceImage::kMaxBins))});
  }
  image.polar = Polar(image);
  return image;
}

}  // namespace lamina
