#include "tools/synth/scenes/ground.h"

#include <algorithm>
#include <cmath>

#include "tools/synth/engine/random.h"

namespace lamina::synth {
namespace {

constexpr float kPavementWidth = 2.5F;

double Blend(double u) { return u * u * u * (u * (6.0 * u - 15.0) + 10.0); }

}  // namespace

double Terrain::Octave(double x, double y, double lattice_m, double amplitude_m) const {
  const double u = x / lattice_m;
  const double v = y / lattice_m;
  const double column = std::floor(u);
  const double row = std::floor(v);
  const auto node = [&](int dx, int dy) {
    const auto octave = static_cast<std::int64_t>(lattice_m);
    return UniformFrom(HashOf({seed_, octave, static_cast<std::int64_t>(column) + dx,
                               static_cast<std::int64_t>(row) + dy}));
  };
  const double a = Blend(u - column);
  const double b = Blend(v - row);
  const double low = (1.0 - a) * node(0, 0) + a * node(1, 0);
  const double high = (1.0 - a) * node(0, 1) + a * node(1, 1);
  return amplitude_m * (2.0 * ((1.0 - b) * low + b * high) - 1.0);
}

double Terrain::SmoothHeight(double x, double y) const {
  return Octave(x, y, 512.0, 3.0) + Octave(x, y, 64.0, 0.35) + Octave(x, y, 16.0, 0.05);
}

double Terrain::Height(double x, double y) const {
  return SmoothHeight(x, y) + Octave(x, y, 4.0, 0.015) + Octave(x, y, 1.0, 0.006);
}

Ground::Ground(const Terrain& terrain, const Eigen::Vector2d& corner, const Eigen::Vector2i& size_m,
               float road_half_width_m, float curb_m)
    : columns_(size_m.x()), rows_(size_m.y()), curb_m_(curb_m) {
  parcel_low_ = Eigen::Array2f::Constant(road_half_width_m);
  parcel_high_ = size_m.cast<float>().array() - road_half_width_m;
  heights_.reserve(static_cast<std::size_t>((columns_ + 1) * (rows_ + 1)));
  for (int row = 0; row <= rows_; ++row) {
    for (int column = 0; column <= columns_; ++column) {
      heights_.push_back(static_cast<float>(terrain.Height(corner.x() + column, corner.y() + row)));
    }
  }
  highest_ = *std::max_element(heights_.begin(), heights_.end()) + curb_m_;
  for (int row = 0; row < rows_; ++row) {
    for (int column = 0; column < columns_; ++column) {
      for (const float end : {0.001F, 0.999F}) {
        const Patch p = PatchAt(static_cast<float>(column) + end, static_cast<float>(row) + end);
        steepest_ = std::max(steepest_, std::hypot(p.slope_x, p.slope_y));
      }
    }
  }
  // The gradient within a patch can exceed those at two of its corners by the twist.
  steepest_ *= 1.5F;
}

Ground::Patch Ground::PatchAt(float x, float y) const {
  const int column = std::clamp(static_cast<int>(x), 0, columns_ - 1);
  const int row = std::clamp(static_cast<int>(y), 0, rows_ - 1);
  const float a = x - static_cast<float>(column);
  const float b = y - static_cast<float>(row);
  const float* low = &heights_[static_cast<std::size_t>(row * (columns_ + 1) + column)];
  const float* high = low + columns_ + 1;
  const float along_low = low[1] - low[0];
  const float along_high = high[1] - high[0];
  const float left = high[0] - low[0];
  const float twist = along_high - along_low;
  return {low[0] + a * along_low + b * (left + a * twist), along_low + b * twist, left + a * twist};
}

bool Ground::InParcel(float x, float y) const {
  return x > parcel_low_.x() && x < parcel_high_.x() && y > parcel_low_.y() && y < parcel_high_.y();
}

float Ground::HeightAt(float x, float y) const {
  return PatchAt(x, y).height + (InParcel(x, y) ? curb_m_ : 0.0F);
}

float Ground::March(const Ray& ray, float raised_m, float enter, float leave) const {
  constexpr int kMaxSteps = 60;
  constexpr float kClose = 1e-3F;
  const float flat = std::hypot(ray.direction.x(), ray.direction.y());
  const float approach = steepest_ * flat - ray.direction.z();  // of ray and ground, at most
  if (approach <= 0.0F) return kNoHit;
  float range = enter;
  for (int step = 0; step < kMaxSteps; ++step) {
    const Eigen::Vector3f p = ray.At(range);
    const Patch patch = PatchAt(p.x(), p.y());
    const float above = p.z() - patch.height - raised_m;
    if (above < kClose) {
      const float closing =
          patch.slope_x * ray.direction.x() + patch.slope_y * ray.direction.y() - ray.direction.z();
      // Nearly parallel to the patch: it may pass over it yet.
      if (closing > 0.05F * approach || above <= 0.0F) {
        const float rest = closing > 1e-4F ? above / closing : 0.0F;
        const float hit = std::max(enter, range + rest);
        return hit <= leave ? hit : kNoHit;
      }
    }
    range += std::max(above, kClose) / approach;
    if (range > leave) return kNoHit;
  }
  return range;
}

void Ground::ParcelInterval(const Ray& ray, float enter, float leave, float* in, float* out) const {
  *in = enter;
  *out = leave;
  for (int axis = 0; axis < 2; ++axis) {
    const float d = ray.direction[axis];
    const float inverse = 1.0F / (std::abs(d) > 1e-12F ? d : 1e-12F);
    const float t1 = (parcel_low_[axis] - ray.origin[axis]) * inverse;
    const float t2 = (parcel_high_[axis] - ray.origin[axis]) * inverse;
    *in = std::max(*in, std::min(t1, t2));
    *out = std::min(*out, std::max(t1, t2));
  }
  if (*in > *out) *in = *out = leave;
}

GroundHit Ground::HitAt(const Ray& ray, float range) const {
  const Eigen::Vector3f p = ray.At(range);
  const Patch patch = PatchAt(p.x(), p.y());
  GroundHit hit;
  hit.range = range;
  hit.normal = Eigen::Vector3f(-patch.slope_x, -patch.slope_y, 1.0F).normalized();
  const Eigen::Array2f xy = p.head<2>().array();
  const float inside = std::min((xy - parcel_low_).minCoeff(), (parcel_high_ - xy).minCoeff());
  if (inside > 0.0F) {
    hit.material = inside < kPavementWidth ? Material::kPavement : Material::kGrass;
  }
  return hit;
}

GroundHit Ground::Cast(const Ray& ray, float enter, float leave) const {
  // Skip what is above the highest point.
  if (ray.origin.z() + enter * ray.direction.z() > highest_) {
    if (ray.direction.z() >= 0.0F) return {};
    enter = (highest_ - ray.origin.z()) / ray.direction.z();
    if (enter > leave) return {};
  }
  float in, out;
  ParcelInterval(ray, enter, leave, &in, &out);
  float range = in > enter ? March(ray, 0.0F, enter, in) : kNoHit;
  if (range == kNoHit && out > in) {
    range = March(ray, curb_m_, in, out);
    if (range == in && in > enter) {
      // Below the parcel's surface where it enters: the curb's face.
      GroundHit hit = HitAt(ray, range);
      const Eigen::Array2f xy = ray.At(range).head<2>().array();
      const Eigen::Array2f off = (xy - parcel_low_).abs().min((xy - parcel_high_).abs());
      hit.normal = off.x() < off.y() ? Eigen::Vector3f::UnitX() : Eigen::Vector3f::UnitY();
      hit.material = Material::kConcrete;
      return hit;
    }
  }
  if (range == kNoHit && out < leave) range = March(ray, 0.0F, out, leave);
  return range == kNoHit ? GroundHit{} : HitAt(ray, range);
}

float Ground::Distance(const Eigen::Vector3f& point) const {
  const Patch patch = PatchAt(point.x(), point.y());
  const float raised = InParcel(point.x(), point.y()) ? curb_m_ : 0.0F;
  const float steepness = std::hypot(1.0F, std::hypot(patch.slope_x, patch.slope_y));
  const float vertical = std::abs(point.z() - patch.height - raised) / steepness;
  // The face of the curb, from the road's height to the parcel's.
  const Eigen::Array2f xy = point.head<2>().array();
  const Eigen::Array2f outside = (parcel_low_ - xy).max(xy - parcel_high_);
  const float in_plan =
      (outside > 0.0F).any() ? outside.max(0.0F).matrix().norm() : -outside.maxCoeff();
  const float above = point.z() - patch.height;
  const float beyond = std::max({0.0F, -above, above - curb_m_});
  return std::min(vertical, std::hypot(in_plan, beyond));
}

}  // namespace lamina::synth
