#include "tools/synth/engine/sensor.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/base/angle.h"
#include "core/base/error.h"
#include "tools/synth/engine/random.h"

namespace lamina::synth {
namespace {

constexpr double kHighestDeg = 15.0, kLowestDeg = -25.0;  // spinning, scattered

std::vector<double> EvenlySpaced(double from, double to, int count) {
  std::vector<double> values;
  for (int i = 0; i < count; ++i) values.push_back(from + (to - from) * i / (count - 1));
  return values;
}

// Direction of one of the six beams of the rosette: the deflections of the two prisms add up to
// circles about one another, stretched to the field of view.
Eigen::Vector3d RosetteDirection(double t_s, std::size_t beam) {
  constexpr double kHalfWidth = 0.5 * 70.4 * kDegree;
  constexpr double kHalfHeight = 0.5 * 77.2 * kDegree;
  // Turns per second, with no common multiple in reach of a recording.
  constexpr double kFirstPrism = 121.5673, kSecondPrism = -77.7271;
  constexpr double kBeamSpacing = 0.55 * kDegree;
  const double first = 2.0 * M_PI * std::fmod(kFirstPrism * t_s, 1.0);
  const double second = 2.0 * M_PI * std::fmod(kSecondPrism * t_s, 1.0);
  const double across = 0.5 * kHalfWidth * (std::cos(first) + std::cos(second));
  const double margin = 2.5 * kBeamSpacing;
  const double up = 0.5 * (kHalfHeight - margin) * (std::sin(first) + std::sin(second)) +
                    kBeamSpacing * (static_cast<double>(beam) - 2.5);
  return {std::cos(up) * std::cos(across), std::cos(up) * std::sin(across), std::sin(up)};
}

// Direction of one of the four beams of the mirror: a turn each 0.1 s, and about 39 swings in it,
// so that the lines of one scan are some 9 deg apart and those of the next lie between them.
Eigen::Vector3d MirrorDirection(double t_s, std::size_t beam) {
  constexpr double kTurns = 10.0, kSwings = 388.6173;  // a second; without a common multiple
  constexpr double kLowest = -7.0 * kDegree, kHighest = 52.0 * kDegree;
  constexpr double kBeamSpacing = 1.0 * kDegree;
  const double azimuth = -2.0 * M_PI * std::fmod(kTurns * t_s, 1.0);
  // Up and down at an even pace.
  const double swing = std::abs(2.0 * std::fmod(kSwings * t_s, 1.0) - 1.0);
  const double up = kLowest + (kHighest - kLowest - 3.0 * kBeamSpacing) * swing +
                    kBeamSpacing * static_cast<double>(beam);
  return {std::cos(up) * std::cos(azimuth), std::cos(up) * std::sin(azimuth), std::sin(up)};
}

// Those whose phase runs on from scan to scan.
bool RunsOn(SensorKind kind) { return kind == SensorKind::kAvia || kind == SensorKind::kMid360; }

}  // namespace

bool IsReturned(Material material, double range_m, double cosine, double max_range_m,
                double chance) {
  const double far = range_m / max_range_m;
  double probability = std::min(1.0, cosine / 0.06);
  // The power that comes back falls with the square of the range; dark surfaces vanish first.
  const double power = Reflectivity(material) * (0.15 + 0.85 * cosine);
  probability *= std::min(1.0, power / (0.15 * far * far + 1e-9));
  if (material == Material::kGlass) probability *= 0.35;
  return chance < probability;
}

float IntensityOf(Material material, double cosine) {
  const double light = Reflectivity(material) * (0.3 + 0.7 * cosine);
  return static_cast<float>(std::round(100.0 * light) / 100.0);
}

const std::vector<std::string>& SensorNames() {
  static const std::vector<std::string> names = {"hdl64",    "avia",      "os1",    "vlp16",
                                                 "spinning", "scattered", "mid360", "os1_128"};
  return names;
}

SensorModel::SensorModel(SensorKind kind, int rays, int beams) : kind_(kind) {
  if (beams != 0 && kind != SensorKind::kSpinning && kind != SensorKind::kScattered) {
    throw OptionError(fmt::format("rings = {}: the sensor {} has its own; give --sensor spinning",
                                  beams, SensorNames()[static_cast<std::size_t>(kind)]));
  }
  switch (kind) {
    case SensorKind::kHdl64: {
      std::vector<double> elevations = EvenlySpaced(2.0, -8.0 - 1.0 / 3.0, 32);
      for (const double e : EvenlySpaced(-8.83, -24.8, 32)) elevations.push_back(e);
      groups_ = 1900;
      min_range_m_ = 0.9;
      max_range_m_ = 120.0;
      SetElevations(elevations);
      break;
    }
    case SensorKind::kOs1:
    case SensorKind::kOs1Of128:
      groups_ = 1024;
      min_range_m_ = 0.3;
      max_range_m_ = 100.0;
      SetElevations(EvenlySpaced(22.5, -22.5, kind == SensorKind::kOs1 ? 64 : 128));
      break;
    case SensorKind::kVlp16:
      groups_ = 1800;
      min_range_m_ = 0.4;
      max_range_m_ = 100.0;
      SetElevations(EvenlySpaced(15.0, -15.0, 16));
      break;
    case SensorKind::kAvia:
      groups_ = 4000;
      rays_per_group_ = 6;
      min_range_m_ = 0.3;
      max_range_m_ = 190.0;
      stamp_fraction_ = 0.0;
      break;
    case SensorKind::kMid360:
      groups_ = 5000;
      rays_per_group_ = 4;
      min_range_m_ = 0.1;
      max_range_m_ = 70.0;
      stamp_fraction_ = 0.0;
      break;
    case SensorKind::kSpinning:
    case SensorKind::kScattered:
      groups_ = 1024;
      min_range_m_ = 0.3;
      max_range_m_ = 120.0;
      SetElevations(EvenlySpaced(kHighestDeg, kLowestDeg, beams == 0 ? 64 : beams));
      break;
  }
  if (rays != 0) {
    const auto per_group = static_cast<double>(rays_per_group_);
    groups_ = static_cast<std::size_t>(std::max(1.0, std::round(rays / per_group)));
  }
}

void SensorModel::SetElevations(std::vector<double> degrees) {
  for (const double e : degrees) beams_.emplace_back(std::cos(kDegree * e), std::sin(kDegree * e));
  rays_per_group_ = beams_.size();
}

double SensorModel::FractionOf(std::int64_t frame, std::size_t group) const {
  // Spinning sensors fire in the middle of their azimuth step, if not anywhere in it.
  double within = RunsOn(kind_) ? 0.0 : 0.5;
  if (kind_ == SensorKind::kSpinning) within = UniformFrom(HashOf({0x591, frame}));
  return (static_cast<double>(group) + within) / static_cast<double>(groups_);
}

double SensorModel::TimeOf(std::int64_t frame, std::size_t group) const {
  return (FractionOf(frame, group) - stamp_fraction_) * period_s();
}

void SensorModel::Directions(std::int64_t frame, std::size_t group,
                             std::vector<Eigen::Vector3d>* directions) const {
  directions->clear();
  if (RunsOn(kind_)) {
    const double t = static_cast<double>(frame) * period_s() + TimeOf(frame, group);
    const auto direction = kind_ == SensorKind::kAvia ? RosetteDirection : MirrorDirection;
    for (std::size_t beam = 0; beam < rays_per_group_; ++beam) {
      directions->push_back(direction(t, beam));
    }
    return;
  }
  if (kind_ == SensorKind::kScattered) {
    for (std::size_t ray = 0; ray < rays_per_group_; ++ray) {
      HashStream random(
          HashOf({0x5ca, frame, static_cast<std::int64_t>(group), static_cast<std::int64_t>(ray)}));
      const double place = static_cast<double>(group) + random.Uniform();
      const double azimuth = M_PI * (1.0 - 2.0 * place / static_cast<double>(groups_));
      const double elevation = kDegree * random.Uniform(kLowestDeg, kHighestDeg);
      const double level = std::cos(elevation);
      directions->emplace_back(level * std::cos(azimuth), level * std::sin(azimuth),
                               std::sin(elevation));
    }
    return;
  }
  const double azimuth = M_PI * (1.0 - 2.0 * FractionOf(frame, group));
  const double c = std::cos(azimuth);
  const double s = std::sin(azimuth);
  for (const Eigen::Vector2d& beam : beams_) {
    directions->emplace_back(beam.x() * c, beam.x() * s, beam.y());
  }
}

}  // namespace lamina::synth
