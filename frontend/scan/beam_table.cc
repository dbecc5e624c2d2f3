#include "frontend/scan/beam_table.h"

#include <algorithm>
#include <cmath>

#include "core/base/angle.h"

namespace lamina {
namespace {

// Of the sine of the elevation, from -1 to 1: 0.007 degrees a cell where sensors look.
constexpr int kCells = 1 << 14;

int CellOf(float sine) {
  const int cell = static_cast<int>((sine + 1.0F) * (0.5F * static_cast<float>(kCells)));
  return std::clamp(cell, 0, kCells - 1);
}

// Of each beam: half the way to its nearest neighbour, and no more than a sensor's beams are off.
std::vector<double> ReachOf(const std::vector<BeamOffset>& beams) {
  constexpr double kMostDeg = 1.0;
  std::vector<double> reach(beams.size(), kMostDeg);
  for (std::size_t b = 0; b + 1 < beams.size(); ++b) {
    const double half = 0.5 * (beams[b + 1].elevation_deg - beams[b].elevation_deg);
    reach[b] = std::min(reach[b], half);
    reach[b + 1] = std::min(reach[b + 1], half);
  }
  return reach;
}

}  // namespace

void VisitBeams(OptionVisitor& v, const char* name, std::vector<BeamOffset>* beams) {
  constexpr std::size_t kMostBeams = 512;
  static const std::vector<OptionColumn> kColumns = {{"elevation_deg", -90.0, 90.0},
                                                     {"elevation_correction_deg", -5.0, 5.0},
                                                     {"range_correction_m", -1.0, 1.0}};
  std::vector<std::vector<double>> rows;
  for (const BeamOffset& b : *beams) {
    rows.push_back({b.elevation_deg, b.elevation_correction_deg, b.range_correction_m});
  }
  v.NumberRows(name, &rows, kColumns, kMostBeams);
  beams->clear();
  for (const std::vector<double>& row : rows) beams->push_back({row[0], row[1], row[2]});
}

BeamTable::BeamTable(const std::vector<BeamOffset>& beams) {
  if (beams.empty()) return;
  std::vector<BeamOffset> sorted = beams;
  std::stable_sort(sorted.begin(), sorted.end(), [](const BeamOffset& a, const BeamOffset& b) {
    return a.elevation_deg < b.elevation_deg;
  });
  const std::vector<double> reach = ReachOf(sorted);
  cells_.assign(kCells, kNoBeam);
  for (std::size_t b = 0; b < sorted.size(); ++b) {
    const BeamOffset& from = sorted[b];
    const double turn = Radians(from.elevation_correction_deg);
    beams_.push_back({static_cast<float>(std::sin(turn)), static_cast<float>(std::cos(turn)),
                      static_cast<float>(from.range_correction_m)});
    const auto cell = [&](double elevation_deg) {
      return CellOf(static_cast<float>(std::sin(Radians(std::clamp(elevation_deg, -90.0, 90.0)))));
    };
    std::fill(cells_.begin() + cell(from.elevation_deg - reach[b]),
              cells_.begin() + cell(from.elevation_deg + reach[b]) + 1,
              static_cast<std::int16_t>(b));
  }
}

int BeamTable::BeamOf(float x, float y, float z) const {
  const float range = std::sqrt(x * x + y * y + z * z);
  if (beams_.empty() || !(range > 0.0F)) return kNoBeam;
  return cells_[static_cast<std::size_t>(CellOf(z / range))];
}

void BeamTable::Correct(std::size_t count, float* x, float* y, float* z) const {
  for (std::size_t i = 0; i < count; ++i) {
    const float flat2 = x[i] * x[i] + y[i] * y[i];
    const float flat = std::sqrt(flat2), range = std::sqrt(flat2 + z[i] * z[i]);
    const int b = BeamOf(x[i], y[i], z[i]);
    if (b == kNoBeam || !(flat > 0.0F)) continue;
    const Beam& beam = beams_[static_cast<std::size_t>(b)];
    // Not below zero: no point changes sides.
    const float longer = std::max(0.0F, 1.0F + beam.longer_m / range);
    const float turned = longer * (beam.cosine - beam.sine * z[i] / flat);
    x[i] *= turned;
    y[i] *= turned;
    z[i] = longer * (beam.cosine * z[i] + beam.sine * flat);
  }
}

std::vector<double> FindBeams(const std::vector<float>& sines_of_elevation) {
  // Files that count in millimetres scatter the points of a beam by 0.01 degrees at 10 m.
  constexpr double kBinDeg = 0.01, kMostWidthDeg = 0.06;
  constexpr std::size_t kBins = 18000, kMostBeams = 512, kLeastBeams = 8, kGapBins = 2;
  constexpr double kEmptyShare = 2e-5, kLeastShare = 5e-4, kOnConesShare = 0.98,
                   kLeastPoints = 20.0;
  std::vector<double> counts(kBins, 0.0), sums(kBins, 0.0);
  for (const float sine : sines_of_elevation) {
    const double deg = Degrees(std::asin(std::clamp(static_cast<double>(sine), -1.0, 1.0)));
    const auto bin = std::min(kBins - 1, static_cast<std::size_t>((deg + 90.0) / kBinDeg));
    counts[bin] += 1.0;
    sums[bin] += deg;
  }
  const auto all = static_cast<double>(sines_of_elevation.size());
  std::vector<double> beams;
  double on_cones = 0.0;
  for (std::size_t bin = 0; bin < kBins;) {
    if (counts[bin] <= kEmptyShare * all) {
      ++bin;
      continue;
    }
    double count = 0.0, sum = 0.0;
    const std::size_t first = bin;
    std::size_t last = bin;
    for (; bin < kBins && bin - last < kGapBins; ++bin) {
      if (counts[bin] <= kEmptyShare * all) continue;
      count += counts[bin];
      sum += sums[bin];
      last = bin;
    }
    const double width_deg = kBinDeg * static_cast<double>(last - first + 1);
    if (count < std::max(kLeastPoints, kLeastShare * all) || width_deg > kMostWidthDeg) continue;
    on_cones += count;
    beams.push_back(Radians(sum / count));
  }
  const bool found =
      beams.size() >= kLeastBeams && beams.size() <= kMostBeams && on_cones >= kOnConesShare * all;
  return found ? beams : std::vector<double>();
}

}  // namespace lamina
