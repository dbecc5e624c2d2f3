#include "tools/synth/scenes/indoor.h"

#include <cmath>
#include <functional>
#include <utility>
#include <vector>

#include "tools/synth/engine/random.h"
#include "tools/synth/scenes/block_models.h"
#include "tools/synth/scenes/furniture.h"
#include "tools/synth/scenes/stairs.h"

namespace lamina::synth {
namespace {

using Eigen::Vector3f;

constexpr float kMargin = 2.0F;  // from the block's corner to the room
const Vector3f kRoomSize(8.0F, 6.0F, 3.0F);
const Vector3f kHallSize(60.0F, 30.0F, 8.0F);

constexpr double kCorridorBlock = 64.0, kCorridorWidth = 2.4, kCorridorHeight = 2.6;

using Fill = std::function<void(const ShapeBuilder& at)>;

std::unique_ptr<SceneModel> MakeSingleBlock(const Vector3f& room, const Fill& fill) {
  const Eigen::Vector2d size = room.head<2>().cast<double>().array() + 2.0 * kMargin;
  return std::make_unique<RowOfBlocks>(size, RowOfBlocks::Extent::kOne,
                                       [fill](std::int64_t, std::vector<Primitive>* out) {
                                         fill(ShapeBuilder(out, {kMargin, kMargin, 0.0F}, 0.0F));
                                       });
}

void FillCorridor(const ShapeBuilder& at) {
  constexpr auto kWidth = static_cast<float>(kCorridorWidth);
  constexpr auto kHeight = static_cast<float>(kCorridorHeight);
  constexpr float kOverlap = 0.01F;  // no gap for rays at the seams
  const Vector3f corner(-kOverlap, 0.0F, 0.0F);
  const Vector3f along(static_cast<float>(kCorridorBlock) + 2.0F * kOverlap, 0.0F, 0.0F);
  const Vector3f across(0.0F, kWidth, 0.0F);
  const Vector3f up(0.0F, 0.0F, kHeight);
  at.Quad(corner, along, across, Material::kPavement);
  at.Quad(corner + up, along, across, Material::kPlaster);
  at.Quad(corner, along, up, Material::kPlaster);
  at.Quad(corner + across, along, up, Material::kPlaster);
}

void FillRoom(const ShapeBuilder& at, std::int64_t seed) {
  HashStream random(HashOf({seed, 0x700}));
  const float x = kRoomSize.x();
  const float y = kRoomSize.y();
  at.Box(Vector3f::Zero(), kRoomSize, Material::kPlaster);  // seen from within
  AddShelf(at.At({0.8F, y - 0.35F, 0.0F}), Draw(&random, 1.6, 2.4), 2.1F, &random);
  AddShelf(at.At({x - 0.35F, 3.4F, 0.0F}, -0.5F * kHalfTurn), 1.4F, 1.5F, &random);
  AddTable(at.At({x - 1.2F, 1.0F, 0.0F}, 0.1F), 1.6F, 0.8F, 0.74F);
  AddChair(at.At({x - 1.3F, 1.8F, 0.0F}, Draw(&random, -0.5, 0.5)));
  AddChair(at.At({x - 2.5F, 0.9F, 0.0F}, 1.4F + Draw(&random, -0.4, 0.4)));
  at.Box({x - 1.5F, 0.7F, 0.74F}, {x - 1.0F, 0.75F, 1.1F}, Material::kGlass);
  AddSofa(at.At({1.4F, 0.6F, 0.0F}, kHalfTurn));
  AddTable(at.At({4.0F, 3.0F, 0.0F}, 0.3F), 1.0F, 0.6F, 0.42F);
  AddPlant(at.At({0.5F, 0.5F, 0.0F}), &random);
  AddPlant(at.At({x - 0.6F, y - 0.6F, 0.0F}), &random);
  for (int i = 0; i < 5; ++i) {
    const float half = Draw(&random, 0.12, 0.3);
    at.At({Draw(&random, 4.0, 7.0), y - 0.4F, 0.0F}, Draw(&random, 0.0, 1.0))
        .Box({-half, -half, 0.0F}, {half, half, Draw(&random, 0.2, 0.8)}, Material::kWood);
  }
  AddWallFrame(at.At({3.2F, 0.0F, 0.0F}), 1.6F, 0.9F, 2.2F, 0.12F, Material::kGlass);
  AddWallFrame(at.At({0.0F, 3.6F, 0.0F}, -0.5F * kHalfTurn), 0.95F, 0.08F, 2.05F, 0.06F,
               Material::kWood);
  AddWallFrame(at.At({x, 4.2F, 0.0F}, 0.5F * kHalfTurn), 1.1F, 1.2F, 1.9F, 0.04F, Material::kCloth);
  at.Box({3.0F, 0.0F, 0.15F}, {5.0F, 0.12F, 0.75F}, Material::kMetal);  // radiator
  at.Tube({4.0F, 3.0F, 2.4F}, {4.0F, 3.0F, 3.0F}, 0.01F, Material::kMetal);
  at.Spheroid({4.0F, 3.0F, 2.35F}, 0.2F, 0.12F, Material::kCloth);   // lamp
  at.Box({0.0F, 2.0F, 2.75F}, {x, 2.2F, 3.0F}, Material::kPlaster);  // beam
}

void FillHall(const ShapeBuilder& at, std::int64_t seed) {
  HashStream random(HashOf({seed, 0x4a11}));
  const Vector3f& size = kHallSize;
  at.Box(Vector3f::Zero(), size, Material::kConcrete);
  for (float x = 6.0F; x < size.x(); x += 6.0F) {
    at.Box({x - 0.2F, 0.0F, size.z() - 0.7F}, {x + 0.2F, size.y(), size.z()}, Material::kConcrete);
    for (const float y : {0.0F, size.y() - 0.3F}) {
      at.Box({x - 0.25F, y, 0.0F}, {x + 0.25F, y + 0.3F, size.z()}, Material::kConcrete);
    }
    // Free-standing pillars in the middle, which the path goes around.
    if (x < 14.0F || x > size.x() - 14.0F) continue;
    at.Box({x - 0.3F, 9.7F, 0.0F}, {x + 0.3F, 10.3F, size.z()}, Material::kConcrete);
    at.Tube({x, 20.0F, 0.0F}, {x, 20.0F, size.z()}, 0.35F, Material::kConcrete);
  }
  const auto crates = [&](float x, float y) {
    const float half = Draw(&random, 0.3, 0.9);
    const float height = Draw(&random, 0.5, 2.4);
    at.At({x, y, 0.0F}, Draw(&random, 0.0, 1.5))
        .Box({-half, -0.8F * half, 0.0F}, {half, 0.8F * half, height}, Material::kWood);
  };
  for (int i = 0; i < 40; ++i) {
    crates(Draw(&random, 17, size.x() - 17), Draw(&random, 11, 19));
    crates(Draw(&random, 1.5, size.x() - 1.5), random.Chance(0.5) ? 1.3F : size.y() - 1.3F);
  }
  for (int i = 0; i < 8; ++i) {
    const float x = 2.0F + 7.0F * static_cast<float>(i);
    AddShelf(at.At({x + 1.0F, size.y() - 0.65F, 0.0F}), 2.2F, 2.6F, &random);
    AddWallFrame(at.At({x, 0.0F, 0.0F}), 2.4F, 3.0F, 6.0F, 0.15F, Material::kGlass);
  }
}

// Around and around an ellipse, looking ahead.
class EllipsePath final : public UprightPath {
 public:
  EllipsePath(const Eigen::Vector3d& centre, double radius_x, double radius_y, double speed)
      : centre_(centre),
        radius_x_(radius_x),
        radius_y_(radius_y),
        rate_(speed * 2.0 / (radius_x + radius_y)) {}
  UprightPose At(double t_s) const override {
    const double phase = rate_ * t_s;
    return {centre_ + Eigen::Vector3d(radius_x_ * std::cos(phase), radius_y_ * std::sin(phase), 0),
            phase + 0.5 * M_PI};
  }

 private:
  Eigen::Vector3d centre_;
  double radius_x_, radius_y_, rate_;
};

class CorridorPath final : public UprightPath {
 public:
  explicit CorridorPath(double speed) : speed_(speed) {}
  UprightPose At(double t_s) const override {
    return {{speed_ * t_s, kMargin + 0.5 * kCorridorWidth + 0.1, kSensorInHand}, 0.0};
  }

 private:
  double speed_;
};

std::shared_ptr<const UprightPath> AroundCentre(const Vector3f& room, double radius_x,
                                                double radius_y, double speed) {
  const Eigen::Vector3d centre(kMargin + 0.5 * room.x(), kMargin + 0.5 * room.y(), kSensorInHand);
  return std::make_shared<EllipsePath>(centre, radius_x, radius_y, speed);
}

}  // namespace

std::unique_ptr<SceneModel> MakeRoom(std::int64_t seed) {
  return MakeSingleBlock(kRoomSize, [seed](const ShapeBuilder& at) { FillRoom(at, seed); });
}

std::unique_ptr<SceneModel> MakeCorridor() {
  return std::make_unique<RowOfBlocks>(
      Eigen::Vector2d(kCorridorBlock, 16.0), RowOfBlocks::Extent::kEndless,
      [](std::int64_t, std::vector<Primitive>* out) {
        FillCorridor(ShapeBuilder(out, {0.0F, kMargin, 0.0F}, 0.0F));
      });
}

std::unique_ptr<SceneModel> MakeStairs(std::int64_t seed) {
  return MakeSingleBlock(StairwellSize(),
                         [seed](const ShapeBuilder& at) { FillStairwell(at, seed); });
}

std::unique_ptr<SceneModel> MakeHall(std::int64_t seed) {
  return MakeSingleBlock(kHallSize, [seed](const ShapeBuilder& at) { FillHall(at, seed); });
}

std::shared_ptr<const UprightPath> MakeIndoorPath(SceneKind kind, double speed_m_per_s) {
  switch (kind) {
    case SceneKind::kRoom:
      return AroundCentre(kRoomSize, 1.7, 1.1, speed_m_per_s);
    case SceneKind::kHall:
      return AroundCentre(kHallSize, 24.0, 11.0, speed_m_per_s);
    case SceneKind::kStairs:
      return std::make_shared<StairPath>(Eigen::Vector3d(kMargin, kMargin, kSensorInHand),
                                         speed_m_per_s);
    default:
      return std::make_shared<CorridorPath>(speed_m_per_s);
  }
}

}  // namespace lamina::synth
