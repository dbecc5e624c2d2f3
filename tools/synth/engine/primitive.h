// The solid vocabulary of synthetic scenes: rectangles, triangles, boxes, tubes and ellipsoids,
// each with a ray intersection and a distance to its surface.
//
// Single precision: coordinates are relative to an origin within some 150 m (the block of the scene
// or the moving object that the primitive belongs to), where a float resolves 10 micrometres.
// Everything here is plain data and pure functions: thread-safe.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <vector>

namespace lamina::synth {

enum class Material : std::uint8_t {
  kAsphalt,
  kPavement,
  kGrass,
  kPlaster,
  kBrick,
  kConcrete,
  kGlass,
  kWood,
  kFoliage,
  kMetal,
  kCarPaint,
  kRetroreflector,
  kCloth,
  kPane,  // glass that most rays pass or are mirrored by; kGlass lets rays vanish
};

// Share of the light that a surface returns at normal incidence, in [0, 1].
float Reflectivity(Material material);

enum class Shape : std::uint8_t { kQuad, kTriangle, kBox, kTube, kEllipsoid };

// What `centre`, `a` and `b` mean depends on the shape; make primitives by the functions below.
struct Primitive {
  Shape shape = Shape::kBox;
  Material material = Material::kConcrete;
  Eigen::Vector3f centre = Eigen::Vector3f::Zero();
  Eigen::Vector3f a = Eigen::Vector3f::Zero();
  Eigen::Vector3f b = Eigen::Vector3f::Zero();
};

// The parallelogram corner + s edge1 + t edge2, s and t in [0, 1], seen from both sides.
Primitive MakeQuad(const Eigen::Vector3f& corner, const Eigen::Vector3f& edge1,
                   const Eigen::Vector3f& edge2, Material material);
// The same with s + t <= 1.
Primitive MakeTriangle(const Eigen::Vector3f& corner, const Eigen::Vector3f& edge1,
                       const Eigen::Vector3f& edge2, Material material);
// A box turned by `yaw` (rad) about z. Seen from within, too: a box can be a room.
Primitive MakeBox(const Eigen::Vector3f& centre, const Eigen::Vector3f& half_size, float yaw,
                  Material material);
// The mantle of a cylinder between two points, open at both ends.
Primitive MakeTube(const Eigen::Vector3f& from, const Eigen::Vector3f& to, float radius,
                   Material material);
// Axes along x, y, z.
Primitive MakeEllipsoid(const Eigen::Vector3f& centre, const Eigen::Vector3f& radii,
                        Material material);

struct Bounds {
  Eigen::Array3f low = Eigen::Array3f::Constant(std::numeric_limits<float>::max());
  Eigen::Array3f high = Eigen::Array3f::Constant(std::numeric_limits<float>::lowest());

  void Add(const Bounds& o) {
    low = low.min(o.low);
    high = high.max(o.high);
  }
  float HalfArea() const {
    const Eigen::Array3f d = (high - low).max(0.0F);
    return d.x() * d.y() + d.y() * d.z() + d.z() * d.x();
  }
};

Bounds BoundsOf(const Primitive& primitive);

// origin + range * direction; the direction has unit length, so that ranges are metres.
struct Ray {
  Eigen::Vector3f origin;
  Eigen::Vector3f direction;
  Eigen::Vector3f At(float range) const { return origin + range * direction; }
};

inline constexpr float kNoHit = std::numeric_limits<float>::infinity();

// Smallest range > 0 at which the ray meets the surface, or kNoHit.
float Intersect(const Primitive& primitive, const Ray& ray);

// Unit normal at a point of the surface, of either sign.
Eigen::Vector3f NormalAt(const Primitive& primitive, const Eigen::Vector3f& point);

// Distance from any point to the surface, >= 0. Exact but for the inside of
// ellipsoids that are no spheres, where it is exact to first order in the distance.
float SurfaceDistance(const Primitive& primitive, const Eigen::Vector3f& point);

// Yaws.
inline constexpr float kQuarterTurn = 1.57079633F, kHalfTurn = 3.14159265F;

// Collects primitives given in a local frame that stands upright at `position`, turned by `yaw`.
class ShapeBuilder {
 public:
  ShapeBuilder(std::vector<Primitive>* out, const Eigen::Vector3f& position, float yaw);

  // A builder for the same collection, placed in the frame of this one.
  ShapeBuilder At(const Eigen::Vector3f& position, float yaw = 0.0F) const;

  void Quad(const Eigen::Vector3f& corner, const Eigen::Vector3f& edge1,
            const Eigen::Vector3f& edge2, Material material) const;
  void Triangle(const Eigen::Vector3f& corner, const Eigen::Vector3f& edge1,
                const Eigen::Vector3f& edge2, Material material) const;
  // The box between two opposite corners.
  void Box(const Eigen::Vector3f& low, const Eigen::Vector3f& high, Material material) const;
  void Tube(const Eigen::Vector3f& from, const Eigen::Vector3f& to, float radius,
            Material material) const;
  // Round in plan, since ellipsoids do not turn with the frame.
  void Spheroid(const Eigen::Vector3f& centre, float radius_xy, float radius_z,
                Material material) const;

  Eigen::Vector3f ToOuter(const Eigen::Vector3f& p) const { return position_ + Turned(p); }

 private:
  Eigen::Vector3f Turned(const Eigen::Vector3f& v) const {
    return {cos_ * v.x() - sin_ * v.y(), sin_ * v.x() + cos_ * v.y(), v.z()};
  }

  std::vector<Primitive>* out_;
  Eigen::Vector3f position_;
  float yaw_, cos_, sin_;
};

}  // namespace lamina::synth
