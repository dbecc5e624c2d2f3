// A submap seen from above, for recognising its place whatever the direction of the visit.
//
// Leaves are brought level (level_frame.h) about the middle of the sensor's way; those that lie
// flat (ground, floors) are left out, and the others occupy bins of 0.5 m of height in square
// cells:
//
//     image(x, y) = number of occupied bins of the cell, at most kMaxBins
//
// in a disc of kRadius cells. The magnitude of its Fourier transform does not change when the image
// is shifted, and turns with it: sampled along kAngles directions of half a turn and kRadii
// radii, a rotation is a shift along the angle, found for all angles at once by one more transform
// (spectral registration; Reddy and Chatterji 1996). Half a turn is all that a magnitude shows: of
// each angle its opposite is a candidate as well.
#pragma once

#include <complex>
#include <cstdint>
#include <vector>

#include "backend/submaps/level_frame.h"
#include "backend/submaps/submap.h"
#include "core/options/options.h"

namespace lamina {

struct PlaceOptions {
  // Edge of a cell of the image, which reaches 62 cells to each side.
  double cell_size_m = 1.0;
  // Submaps that are compared in full, of those that look most alike.
  int candidates = 12;
  // How far the vertical of a submap may lean, in the frame of its first keyframe.
  double max_tilt_deg = 35.0;

  void Visit(OptionVisitor& v);
};

struct PlaceImage {
  static constexpr int kCells = 128, kRadius = 62, kMaxBins = 12;
  static constexpr int kAngles = 128, kRadii = 24;
  static constexpr double kBinM = 0.5;

  // Rotation: z is up. Origin: the middle of the sensor's way.
  SE3 T_level_submap;
  struct Cell {
    std::int8_t x = 0, y = 0;  // from the origin, the cell [x, x + 1) * cell_size_m
    std::uint8_t bins = 0;
  };
  std::vector<Cell> cells;
  // Lowest flat leaf of each cell that has one, metres above the origin.
  struct Ground {
    std::int8_t x = 0, y = 0;
    float height_m = 0.0F;
  };
  std::vector<Ground> ground;
  // For each radius, the transform along the angle of log(1 + magnitude), its mean left out;
  // kAngles / 2 numbers each, all together of length 1.
  std::vector<std::complex<float>> polar;

  // Of the sensor's way, in the submap's frame.
  Eigen::Vector3d middle() const { return T_level_submap.Inverse().t; }

  void Archive(StateArchive& a);
};
template <>
inline constexpr bool kPlainState<PlaceImage::Cell> = true;
static_assert(sizeof(PlaceImage::Cell) == 3);
template <>
inline constexpr bool kPlainState<std::complex<float>> = true;

// `expected_up` in the submap's frame. Pure function.
PlaceImage MakePlaceImage(const Submap& submap, const std::vector<LeafPlane>& planes,
                          const PlaceOptions& options, const Eigen::Vector3d& expected_up);

// Discrete Fourier transform of kCells x kCells numbers, rows one after the other; the result is
// transposed. `inverse` is scaled so that it undoes the other, and transposes back.
using ImageSpectrum = std::vector<std::complex<float>>;
void Transform(ImageSpectrum* image, bool inverse);

// The image turned by `yaw` (rad, anticlockwise), transformed.
ImageSpectrum TurnedSpectrum(const PlaceImage& image, double yaw);

}  // namespace lamina
