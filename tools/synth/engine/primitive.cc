#include "tools/synth/engine/primitive.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

namespace lamina::synth {
namespace {

using Eigen::Vector3f;

// Into the frame of a box: turned back by its yaw, b = (cos, sin, 0).
Vector3f TurnedBack(const Vector3f& b, const Vector3f& v) {
  return {b.x() * v.x() + b.y() * v.y(), b.x() * v.y() - b.y() * v.x(), v.z()};
}

float IntersectFlat(const Primitive& p, const Ray& ray) {
  const Vector3f h = ray.direction.cross(p.b);
  const float determinant = p.a.dot(h);
  if (std::abs(determinant) < 1e-12F) return kNoHit;
  const float inverse = 1.0F / determinant;
  const Vector3f from_corner = ray.origin - p.centre;
  const float s = from_corner.dot(h) * inverse;
  if (s < 0.0F || s > 1.0F) return kNoHit;
  const Vector3f q = from_corner.cross(p.a);
  const float t = ray.direction.dot(q) * inverse;
  const float limit = p.shape == Shape::kTriangle ? 1.0F - s : 1.0F;
  if (t < 0.0F || t > limit) return kNoHit;
  const float range = p.b.dot(q) * inverse;
  return range > 0.0F ? range : kNoHit;
}

float IntersectBox(const Primitive& p, const Ray& ray) {
  const Vector3f o = TurnedBack(p.b, ray.origin - p.centre);
  const Vector3f d = TurnedBack(p.b, ray.direction);
  float enter = -kNoHit;
  float leave = kNoHit;
  for (int axis = 0; axis < 3; ++axis) {
    // A tiny denominator stands for a ray parallel to the face: both ranges become huge.
    const float inverse = 1.0F / (std::abs(d[axis]) > 1e-12F ? d[axis] : 1e-12F);
    const float t1 = (-p.a[axis] - o[axis]) * inverse;
    const float t2 = (p.a[axis] - o[axis]) * inverse;
    enter = std::max(enter, std::min(t1, t2));
    leave = std::min(leave, std::max(t1, t2));
  }
  if (enter > leave || leave <= 0.0F) return kNoHit;
  return enter > 0.0F ? enter : leave;
}

// First range > 0 at which |d t + o|^2 = square and valid(t), t = range - ahead. `o` is the point
// of the ray nearest to the object's centre, at range `ahead`: from an origin many radii away the
// digits of the discriminant would be lost.
template <typename Valid>
float FirstCrossing(const Vector3f& d, const Vector3f& o, float square, float ahead,
                    const Valid& valid) {
  const float a = d.squaredNorm();
  const float b = d.dot(o);
  const float discriminant = b * b - a * (o.squaredNorm() - square);
  if (discriminant < 0.0F || a < 1e-12F) return kNoHit;
  const float root = std::sqrt(discriminant);
  for (const float t : {(-b - root) / a, (-b + root) / a}) {
    if (ahead + t > 0.0F && valid(t)) return ahead + t;
  }
  return kNoHit;
}

float IntersectTube(const Primitive& p, const Ray& ray) {
  const float radius = p.b.x();
  const float length = p.b.y();
  const Vector3f from_start = ray.origin - p.centre;
  const float ahead = -from_start.dot(ray.direction);
  const Vector3f o = from_start + ahead * ray.direction;
  const float d_axis = ray.direction.dot(p.a);
  const float o_axis = o.dot(p.a);
  return FirstCrossing(ray.direction - d_axis * p.a, o - o_axis * p.a, radius * radius, ahead,
                       [&](float t) {
                         const float along = o_axis + t * d_axis;
                         return along >= 0.0F && along <= length;
                       });
}

float IntersectEllipsoid(const Primitive& p, const Ray& ray) {
  const Vector3f from_centre = ray.origin - p.centre;
  const float ahead = -from_centre.dot(ray.direction);
  const Vector3f o = (from_centre + ahead * ray.direction).cwiseQuotient(p.a);
  return FirstCrossing(ray.direction.cwiseQuotient(p.a), o, 1.0F, ahead,
                       [](float) { return true; });
}

float SegmentDistance(const Vector3f& from, const Vector3f& edge, const Vector3f& point) {
  const float s = std::clamp(edge.dot(point - from) / edge.squaredNorm(), 0.0F, 1.0F);
  return (from + s * edge - point).norm();
}

float FlatDistance(const Primitive& p, const Vector3f& point) {
  const Vector3f normal = p.a.cross(p.b);
  const Vector3f d = point - p.centre;
  const float inverse = 1.0F / normal.squaredNorm();
  const float s = d.cross(p.b).dot(normal) * inverse;
  const float t = p.a.cross(d).dot(normal) * inverse;
  const float limit = p.shape == Shape::kTriangle ? 1.0F - s : 1.0F;
  if (s >= 0.0F && s <= 1.0F && t >= 0.0F && t <= limit) {
    return std::abs(d.dot(normal)) * std::sqrt(inverse);
  }
  const float near =
      std::min(SegmentDistance(p.centre, p.a, point), SegmentDistance(p.centre, p.b, point));
  if (p.shape == Shape::kTriangle) {
    return std::min(near, SegmentDistance(p.centre + p.a, p.b - p.a, point));
  }
  return std::min({near, SegmentDistance(p.centre + p.a, p.b, point),
                   SegmentDistance(p.centre + p.b, p.a, point)});
}

float BoxDistance(const Primitive& p, const Vector3f& point) {
  const Vector3f q = TurnedBack(p.b, point - p.centre).cwiseAbs() - p.a;
  const float deepest = q.maxCoeff();
  return deepest > 0.0F ? q.cwiseMax(0.0F).norm() : -deepest;
}

float TubeDistance(const Primitive& p, const Vector3f& point) {
  const Vector3f d = point - p.centre;
  const float along = d.dot(p.a);
  const float radial = (d - along * p.a).norm() - p.b.x();
  const float beyond = std::max({0.0F, -along, along - p.b.y()});
  return std::hypot(radial, beyond);
}

// The nearest point q of the surface has p - q along the surface's normal, q_i = r_i^2 p_i / (r_i^2
// + t), where t solves F(t) = sum_i (r_i p_i / (r_i^2 + t))^2 - 1 = 0. For p outside F is convex
// and falling from F(0) > 0, so Newton's steps from 0 rise to the root.
float EllipsoidDistance(const Primitive& p, const Vector3f& point) {
  const Vector3f d = point - p.centre;
  const Vector3f scaled = d.cwiseQuotient(p.a);
  const float level = scaled.norm();
  if (level <= 1.0F) {
    const float gradient = scaled.cwiseQuotient(p.a).norm();
    const float inside = level * (1.0F - level) / std::max(gradient, 1e-6F);
    return level < 1e-3F ? p.a.minCoeff() : inside;
  }
  const Eigen::Array3f square = p.a.array().square();
  float t = 0.0F;
  for (int step = 0; step < 20; ++step) {
    const Eigen::Array3f terms = (p.a.array() * d.array() / (square + t)).square();
    const float rise = 0.5F * (terms.sum() - 1.0F) / (terms / (square + t)).sum();
    t += rise;
    if (rise <= 1e-6F * (square.minCoeff() + t)) break;
  }
  return (d.array() * t / (square + t)).matrix().norm();
}

}  // namespace

float Reflectivity(Material material) {
  static constexpr std::array<float, 14> kReflectivity = {0.18F, 0.35F, 0.30F, 0.55F, 0.40F,
                                                          0.38F, 0.10F, 0.45F, 0.32F, 0.50F,
                                                          0.42F, 1.0F,  0.36F, 0.30F};
  return kReflectivity[static_cast<std::size_t>(material)];
}

Primitive MakeQuad(const Vector3f& corner, const Vector3f& edge1, const Vector3f& edge2,
                   Material material) {
  return {Shape::kQuad, material, corner, edge1, edge2};
}

Primitive MakeTriangle(const Vector3f& corner, const Vector3f& edge1, const Vector3f& edge2,
                       Material material) {
  return {Shape::kTriangle, material, corner, edge1, edge2};
}

Primitive MakeBox(const Vector3f& centre, const Vector3f& half_size, float yaw, Material material) {
  return {Shape::kBox, material, centre, half_size, {std::cos(yaw), std::sin(yaw), 0.0F}};
}

Primitive MakeTube(const Vector3f& from, const Vector3f& to, float radius, Material material) {
  const float length = (to - from).norm();
  return {Shape::kTube, material, from, (to - from) / length, {radius, length, 0.0F}};
}

Primitive MakeEllipsoid(const Vector3f& centre, const Vector3f& radii, Material material) {
  return {Shape::kEllipsoid, material, centre, radii, Vector3f::Zero()};
}

Bounds BoundsOf(const Primitive& p) {
  Bounds bounds;
  const auto add = [&bounds](const Vector3f& low, const Vector3f& high) {
    bounds.Add({low.array(), high.array()});
  };
  switch (p.shape) {
    case Shape::kQuad:
      add(p.centre + p.a + p.b, p.centre + p.a + p.b);
      [[fallthrough]];
    case Shape::kTriangle:
      add(p.centre, p.centre);
      add(p.centre + p.a, p.centre + p.a);
      add(p.centre + p.b, p.centre + p.b);
      break;
    case Shape::kBox: {
      const float c = std::abs(p.b.x());
      const float s = std::abs(p.b.y());
      const Vector3f half(c * p.a.x() + s * p.a.y(), s * p.a.x() + c * p.a.y(), p.a.z());
      add(p.centre - half, p.centre + half);
      break;
    }
    case Shape::kTube: {
      const Vector3f end = p.centre + p.b.y() * p.a;
      // A circle about the axis a reaches r sqrt(1 - a_i^2) along coordinate i.
      const Vector3f reach = p.b.x() * (1.0F - p.a.array().square()).max(0.0F).sqrt().matrix();
      add(p.centre - reach, p.centre + reach);
      add(end - reach, end + reach);
      break;
    }
    case Shape::kEllipsoid:
      add(p.centre - p.a, p.centre + p.a);
      break;
  }
  return bounds;
}

float Intersect(const Primitive& primitive, const Ray& ray) {
  switch (primitive.shape) {
    case Shape::kQuad:
    case Shape::kTriangle:
      return IntersectFlat(primitive, ray);
    case Shape::kBox:
      return IntersectBox(primitive, ray);
    case Shape::kTube:
      return IntersectTube(primitive, ray);
    case Shape::kEllipsoid:
      return IntersectEllipsoid(primitive, ray);
  }
  return kNoHit;
}

Vector3f NormalAt(const Primitive& p, const Vector3f& point) {
  const Vector3f d = point - p.centre;
  switch (p.shape) {
    case Shape::kQuad:
    case Shape::kTriangle:
      return p.a.cross(p.b).normalized();
    case Shape::kBox: {
      const Vector3f depth = TurnedBack(p.b, d).cwiseAbs() - p.a;
      int axis = 0;
      depth.maxCoeff(&axis);
      if (axis == 2) return Vector3f::UnitZ();
      return axis == 0 ? Vector3f(p.b.x(), p.b.y(), 0.0F) : Vector3f(-p.b.y(), p.b.x(), 0.0F);
    }
    case Shape::kTube:
      return (d - d.dot(p.a) * p.a).normalized();
    case Shape::kEllipsoid:
      return d.cwiseQuotient(p.a.cwiseAbs2()).normalized();
  }
  return Vector3f::UnitZ();
}

float SurfaceDistance(const Primitive& primitive, const Vector3f& point) {
  switch (primitive.shape) {
    case Shape::kQuad:
    case Shape::kTriangle:
      return FlatDistance(primitive, point);
    case Shape::kBox:
      return BoxDistance(primitive, point);
    case Shape::kTube:
      return TubeDistance(primitive, point);
    case Shape::kEllipsoid:
      return EllipsoidDistance(primitive, point);
  }
  return kNoHit;
}

ShapeBuilder::ShapeBuilder(std::vector<Primitive>* out, const Vector3f& position, float yaw)
    : out_(out), position_(position), yaw_(yaw), cos_(std::cos(yaw)), sin_(std::sin(yaw)) {}

ShapeBuilder ShapeBuilder::At(const Vector3f& position, float yaw) const {
  return ShapeBuilder(out_, ToOuter(position), yaw_ + yaw);
}

void ShapeBuilder::Quad(const Vector3f& corner, const Vector3f& edge1, const Vector3f& edge2,
                        Material material) const {
  out_->push_back(MakeQuad(ToOuter(corner), Turned(edge1), Turned(edge2), material));
}

void ShapeBuilder::Triangle(const Vector3f& corner, const Vector3f& edge1, const Vector3f& edge2,
                            Material material) const {
  out_->push_back(MakeTriangle(ToOuter(corner), Turned(edge1), Turned(edge2), material));
}

void ShapeBuilder::Box(const Vector3f& low, const Vector3f& high, Material material) const {
  out_->push_back(MakeBox(ToOuter(0.5F * (low + high)), 0.5F * (high - low), yaw_, material));
}

void ShapeBuilder::Tube(const Vector3f& from, const Vector3f& to, float radius,
                        Material material) const {
  out_->push_back(MakeTube(ToOuter(from), ToOuter(to), radius, material));
}

void ShapeBuilder::Spheroid(const Vector3f& centre, float radius_xy, float radius_z,
                            Material material) const {
  out_->push_back(MakeEllipsoid(ToOuter(centre), {radius_xy, radius_xy, radius_z}, material));
}

}  // namespace lamina::synth
