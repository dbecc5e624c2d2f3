// Uneven ground: an endless terrain as a function of the place, and its tabulated piece in a block.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "tools/synth/engine/primitive.h"

namespace lamina::synth {

// Sum of octaves of value noise: hashed heights at the points of a lattice, blended by a quintic
// that is smooth to the second derivative. Thread-safe.
class Terrain {
 public:
  explicit Terrain(std::int64_t seed) : seed_(seed) {}

  // Hills and long waves only: what the body of a car follows. Metres.
  double SmoothHeight(double x, double y) const;
  // With the unevenness of a few centimetres over metres that a laser sees.
  double Height(double x, double y) const;

 private:
  double Octave(double x, double y, double lattice_m, double amplitude_m) const;
  std::int64_t seed_;
};

struct GroundHit {
  float range = kNoHit;
  Eigen::Vector3f normal = Eigen::Vector3f::UnitZ();
  Material material = Material::kAsphalt;
};

// The ground of one block, in coordinates relative to the block's corner: a road along each edge,
// and in the middle a rectangular parcel that stands a curb's height above the road. Between the
// nodes of a 1 m grid the height is bilinear. Immutable: thread-safe.
class Ground {
 public:
  // `corner` is the block's corner, `size` whole metres; the parcel begins `road_half_width_m`
  // inside of the block's edges.
  Ground(const Terrain& terrain, const Eigen::Vector2d& corner, const Eigen::Vector2i& size_m,
         float road_half_width_m, float curb_m);

  // Height of the surface, curb included.
  float HeightAt(float x, float y) const;

  // First meeting with the surface for ranges in [enter, leave], within which the ray is above the
  // block. Marches by steps of at most f / (L |d_xy| - d_z), f the height above the ground and L a
  // bound of its slope, so no bump is stepped over.
  GroundHit Cast(const Ray& ray, float enter, float leave) const;

  // Distance from a point to the surface: exact to first order in the slope.
  float Distance(const Eigen::Vector3f& point) const;

 private:
  struct Patch {
    float height;
    float slope_x, slope_y;
  };
  Patch PatchAt(float x, float y) const;
  bool InParcel(float x, float y) const;
  float March(const Ray& ray, float raised_m, float enter, float leave) const;
  // Ranges at which the ray crosses the parcel's outline, clipped to [enter, leave].
  void ParcelInterval(const Ray& ray, float enter, float leave, float* in, float* out) const;
  GroundHit HitAt(const Ray& ray, float range) const;

  int columns_, rows_;
  std::vector<float> heights_;
  float steepest_ = 0.0F;
  float highest_ = 0.0F;
  Eigen::Array2f parcel_low_, parcel_high_;
  float curb_m_;
};

}  // namespace lamina::synth
