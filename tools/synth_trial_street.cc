#include "tools/synth_trial_street.h"

#include "tools/synth_block_models.h"
#include "tools/synth_random.h"

namespace lamina::synth {
namespace {

using Eigen::Vector3f;

constexpr float kOverlap = 0.01F;  // no gap for rays at the seams of blocks
constexpr float kMiddle = 0.5F * static_cast<float>(kTrialStreetWidth);

constexpr float kBay = 5.0F;
constexpr int kBaysOfBlock = 8;
constexpr float kFacade = 8.0F;  // from the middle of the street
constexpr float kHeight = 9.0F;
constexpr double kStandsOutMost = 1.5;

// How far the bay with this number stands out on one side of the street.
float StandsOut(std::int64_t seed, int side, std::int64_t bay) {
  return static_cast<float>(kStandsOutMost * UniformFrom(HashOf({seed, 0xba1, side, bay})));
}

void AddGround(const ShapeBuilder& at, float length) {
  at.Quad({-kOverlap, 0.0F, 0.0F}, {length + 2.0F * kOverlap, 0.0F, 0.0F},
          {0.0F, static_cast<float>(kTrialStreetWidth), 0.0F}, Material::kAsphalt);
}

void FillBays(std::int64_t seed, std::int64_t block, const ShapeBuilder& at) {
  AddGround(at, kBay * kBaysOfBlock);
  const Vector3f up(0.0F, 0.0F, kHeight);
  for (const int side : {-1, 1}) {
    const auto sign = static_cast<float>(side);
    for (int i = 0; i < kBaysOfBlock; ++i) {
      const std::int64_t bay = block * kBaysOfBlock + i;
      const float x = kBay * static_cast<float>(i);
      const float before = kMiddle + sign * (kFacade - StandsOut(seed, side, bay - 1));
      const float here = kMiddle + sign * (kFacade - StandsOut(seed, side, bay));
      at.Quad({x, here, 0.0F}, {kBay, 0.0F, 0.0F}, up, Material::kPlaster);
      at.Quad({x, before, 0.0F}, {0.0F, here - before, 0.0F}, up, Material::kPlaster);
    }
  }
}

}  // namespace

std::unique_ptr<SceneModel> MakeBays(std::int64_t seed) {
  return std::make_unique<RowOfBlocks>(
      Eigen::Vector2d(kBay * kBaysOfBlock, kTrialStreetWidth), RowOfBlocks::Extent::kEndless,
      [seed](std::int64_t block, std::vector<Primitive>* out) {
        FillBays(seed, block, ShapeBuilder(out, Vector3f::Zero(), 0.0F));
      });
}

}  // namespace lamina::synth
