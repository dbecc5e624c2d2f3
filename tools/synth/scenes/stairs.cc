#include "tools/synth/scenes/stairs.h"

#include <algorithm>
#include <cmath>

#include "tools/synth/engine/random.h"

namespace lamina::synth {
namespace {

using Eigen::Vector3f;

constexpr int kStoreys = 6;
constexpr int kSteps = 9;  // in each flight
constexpr float kRise = 1.5F / kSteps, kTread = 0.28F;
constexpr float kStairsStorey = 2.0F * kRise * kSteps;
constexpr float kLanding = 1.4F;  // along x, at both ends
constexpr float kFlight = 1.2F;   // width
constexpr float kEye = 0.2F;      // between the flights
constexpr float kRun = kSteps * kTread;
constexpr float kStairsLength = 2.0F * kLanding + kRun;
constexpr float kStairsWidth = 2.0F * kFlight + kEye;
constexpr float kSlab = 0.18F;
constexpr float kRail = 0.9F;

// A flight from x = 0, z = 0 upwards along x, y in [0, kFlight], with its rail at y = kFlight.
void AddFlight(const ShapeBuilder& at) {
  for (int i = 0; i < kSteps; ++i) {
    const float x = kTread * static_cast<float>(i);
    const float top = kRise * static_cast<float>(i + 1);
    at.Box({x, 0.0F, top - kRise - 0.12F}, {x + kTread, kFlight, top}, Material::kConcrete);
    at.Tube({x + 0.5F * kTread, kFlight, top}, {x + 0.5F * kTread, kFlight, top + kRail}, 0.012F,
            Material::kMetal);
  }
  at.Tube({0.0F, kFlight, kRail + 0.5F * kRise}, {kRun, kFlight, kRail + kRise * (kSteps + 0.5F)},
          0.025F, Material::kMetal);
}

// A turned-back flight climbs along -x: its frame starts at the upper end of the lower flight.
void AddStorey(const ShapeBuilder& at, HashStream* random) {
  constexpr float kMiddle = 0.5F * kStairsStorey;
  AddFlight(at.At({kLanding, 0.0F, 0.0F}));
  at.Box({kLanding + kRun, 0.0F, kMiddle - kSlab}, {kStairsLength, kStairsWidth, kMiddle},
         Material::kConcrete);
  AddFlight(at.At({kLanding + kRun, kStairsWidth, kMiddle}, kHalfTurn));
  at.Box({0.0F, 0.0F, kStairsStorey - kSlab}, {kLanding, kStairsWidth, kStairsStorey},
         Material::kConcrete);
  // A door frame on the main landing, a window on the middle one, at places of their own.
  const auto shift = static_cast<float>(random->Uniform(0.0, 0.9));
  for (const float y : {0.3F + shift, 1.25F + shift}) {
    at.Box({0.0F, y, 0.0F}, {0.09F, y + 0.08F, 2.1F}, Material::kWood);
  }
  at.Box({0.0F, 0.3F + shift, 2.1F}, {0.09F, 1.33F + shift, 2.18F}, Material::kWood);
  const auto sill = static_cast<float>(random->Uniform(0.7, 1.1));
  at.Box({kStairsLength - 0.15F, 0.6F, kMiddle + sill},
         {kStairsLength, 2.0F, kMiddle + sill + 0.05F}, Material::kPavement);
  // Something left on a landing.
  const auto size = static_cast<float>(random->Uniform(0.15, 0.3));
  const float x = random->Chance(0.5) ? 0.35F : kStairsLength - 0.35F;
  const float z = x > kLanding ? kMiddle : 0.0F;
  at.At({x, kStairsWidth - 0.35F, z}, size)
      .Box({-size, -size, 0.0F}, {size, size, 3.0F * size}, Material::kWood);
}

// The walked line without smoothing: `arc` metres from the bottom, in plan.
struct Corner {
  Eigen::Vector3d position;
  double yaw;
};

Corner WalkedTo(double arc) {
  constexpr double kNear = 0.5 * kLanding, kFar = kStairsLength - 0.5 * kLanding;
  constexpr double kRight = 0.5 * kFlight, kLeft = kStairsWidth - 0.5 * kFlight;
  constexpr double kAlong = kFar - kNear, kAcross = kLeft - kRight;
  constexpr double kHalf = kAlong + kAcross;
  const double half_storeys = std::floor(arc / kHalf);
  const double rest = arc - half_storeys * kHalf;
  const double along = std::min(rest, kAlong);
  const double across = std::max(0.0, rest - kAlong);
  const bool back = std::fmod(half_storeys, 2.0) != 0.0;
  // A turn of half a circle on each landing.
  const double yaw = M_PI * (half_storeys + across / kAcross);
  const double climbed = std::clamp((along - 0.5 * kLanding) / kRun, 0.0, 1.0);
  const double z = 0.5 * kStairsStorey * (half_storeys + climbed);
  if (back) return {{kFar - along, kLeft - across, z}, yaw};
  return {{kNear + along, kRight + across, z}, yaw};
}

// The arc length of the whole way up, but for the last landing.
constexpr double kWayUp =
    (kStoreys * 2.0 - 1.0) * (kStairsLength - kLanding + kFlight + kEye) + kStairsLength - kLanding;

}  // namespace

Vector3f StairwellSize() { return {kStairsLength, kStairsWidth, kStoreys * kStairsStorey + 2.6F}; }

void FillStairwell(const ShapeBuilder& at, std::int64_t seed) {
  HashStream random(HashOf({seed, 0x57a1}));
  at.Box(Vector3f::Zero(), StairwellSize(), Material::kPlaster);
  for (int storey = 0; storey < kStoreys; ++storey) {
    AddStorey(at.At({0.0F, 0.0F, kStairsStorey * static_cast<float>(storey)}), &random);
  }
}

UprightPose StairPath::At(double t_s) const {
  // Averaged over a second or so of the walk, which rounds its corners.
  constexpr int kSamples = 64;
  constexpr double kWindow = 1.0;  // metres
  Corner mean{Eigen::Vector3d::Zero(), 0.0};
  for (int k = 0; k < kSamples; ++k) {
    const double phase = (k + 0.5) / kSamples - 0.5;
    const double weight = (1.0 + std::cos(2.0 * M_PI * phase)) / kSamples;
    const double walked = std::abs(speed_ * t_s + 0.5 * kWindow + kWindow * phase);
    const double lap = std::fmod(walked, 2.0 * kWayUp);
    const Corner corner = WalkedTo(std::min(lap, 2.0 * kWayUp - lap));
    mean.position += weight * corner.position;
    mean.yaw += weight * corner.yaw;
  }
  return {corner_ + mean.position, mean.yaw};
}

}  // namespace lamina::synth
