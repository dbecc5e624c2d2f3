#include "io/message/velodyne_packet.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <cstring>

#include "core/base/error.h"

namespace lamina {
namespace {

constexpr const VelodyneModel* kModels[] = {&kVlp16, &kVlp32c, &kHdl32e};

constexpr std::size_t kBlocks = 12, kBlockBytes = 100, kBlockHead = 4, kReturns = 32;
constexpr std::size_t kReturnBytes = 3, kTimeAt = 1200, kModeAt = 1204, kModelAt = 1205;
constexpr std::uint8_t kDual = 0x39;
constexpr std::uint16_t kBlockFlag = 0xEEFF;
constexpr std::uint32_t kTurn = 36000;
constexpr double kUsPerHour = 3600e6;

template <typename T>
T NumberAt(std::string_view packet, std::size_t at) {
  T value;
  std::memcpy(&value, packet.data() + at, sizeof(T));
  return value;
}

const VelodyneModel* FindModel(std::uint8_t id) {
  for (const VelodyneModel* model : kModels) {
    if (model->id == id) return model;
  }
  return nullptr;
}

std::string_view Block(std::string_view packet, std::size_t b) {
  return packet.substr(b * kBlockBytes, kBlockBytes);
}

std::uint32_t AzimuthOf(std::string_view block) { return NumberAt<std::uint16_t>(block, 2); }

// How far the sensor turns, in 0.01 deg, from each block to the next one that fires later. Of the
// last one it is taken as before.
std::array<double, kBlocks> TurnsOf(std::string_view packet, std::size_t apart) {
  // Three times that of a sensor at 20 Hz.
  constexpr std::uint32_t kMost = 300;
  std::array<double, kBlocks> turns{};
  double last = 0.0;
  for (std::size_t b = 0; b < kBlocks; ++b) {
    if (b + apart < kBlocks) {
      const std::uint32_t turn =
          (AzimuthOf(Block(packet, b + apart)) + kTurn - AzimuthOf(Block(packet, b)) % kTurn) %
          kTurn;
      if (turn <= kMost) last = turn;
    }
    turns[b] = last;
  }
  return turns;
}

// Sine and cosine of the beams of a model, which many points share.
struct BeamAngles {
  float sine[kReturns], cosine[kReturns];
  explicit BeamAngles(const VelodyneModel& model) : sine{}, cosine{} {
    for (std::size_t i = 0; i < model.beam_count; ++i) {
      const double elevation = model.beams[i].elevation_deg * M_PI / 180.0;
      sine[i] = static_cast<float>(std::sin(elevation));
      cosine[i] = static_cast<float>(std::cos(elevation));
    }
  }
};

}  // namespace

std::uint32_t VelodyneAzimuth(std::string_view packet) {
  if (packet.size() != kVelodynePacketBytes) return kTurn;
  const std::string_view block = Block(packet, 0);
  if (NumberAt<std::uint16_t>(block, 0) != kBlockFlag) return kTurn;
  return AzimuthOf(block) % kTurn;
}

double VelodyneDecoder::StartOf(std::string_view packet, StampNs stamp_ns) {
  constexpr double kSameClockS = 0.05;
  const double us = static_cast<double>(NumberAt<std::uint32_t>(packet, kTimeAt)) -
                    static_cast<double>(first_us_);
  const double own_s = 1e-6 * (us < -0.5 * kUsPerHour ? us + kUsPerHour : us);
  const double received_s = SecondsBetween(first_stamp_ns_, stamp_ns);
  return std::abs(own_s - received_s) <= kSameClockS ? own_s : received_s;
}

void VelodyneDecoder::Add(std::string_view packet, StampNs stamp_ns, const std::string& name,
                          Scan* scan) {
  if (VelodyneAzimuth(packet) == kTurn) return;
  const auto id = NumberAt<std::uint8_t>(packet, kModelAt);
  const VelodyneModel* model = FindModel(id);
  if (model == nullptr) {
    throw InputError(fmt::format(
        "{}: packets of a Velodyne sensor that is not read ({:#04x}); read are VLP-16, VLP-32C and "
        "HDL-32E",
        name, id));
  }
  if (model_ == nullptr) {
    first_stamp_ns_ = stamp_ns;
    first_us_ = NumberAt<std::uint32_t>(packet, kTimeAt);
  }
  model_ = model;
  dual_ = NumberAt<std::uint8_t>(packet, kModeAt) == kDual;
  const double start_s = StartOf(packet, stamp_ns);
  const std::size_t apart = dual_ ? 2 : 1, firings = kReturns / model->beam_count;
  const BeamAngles angles(*model);
  const std::array<double, kBlocks> turns = TurnsOf(packet, apart);
  const double block_us = static_cast<double>(firings) * model->firing_us;
  for (std::size_t b = 0; b < kBlocks; ++b) {
    const std::string_view block = Block(packet, b);
    if (NumberAt<std::uint16_t>(block, 0) != kBlockFlag) continue;
    for (std::size_t k = 0; k < kReturns; ++k) {
      const std::size_t at = kBlockHead + k * kReturnBytes;
      const auto distance = NumberAt<std::uint16_t>(block, at);
      if (distance == 0) continue;
      // Of two equal returns of one pulse the second tells nothing.
      if (dual_ && b % 2 == 1 && NumberAt<std::uint16_t>(Block(packet, b - 1), at) == distance) {
        continue;
      }
      const std::size_t beam = k % model->beam_count;
      const double in_block_us = static_cast<double>(k / model->beam_count) * model->firing_us +
                                 static_cast<double>(beam / model->at_once) * model->laser_us;
      const double azimuth_deg = 0.01 * (AzimuthOf(block) + turns[b] * in_block_us / block_us) +
                                 model->beams[beam].azimuth_deg;
      const auto azimuth = static_cast<float>(azimuth_deg * M_PI / 180.0);
      const auto range = static_cast<float>(distance * model->range_unit_m);
      const float flat = range * angles.cosine[beam];
      // The azimuth grows clockwise, from the front on.
      scan->points.push_back(
          {flat * std::cos(azimuth), -flat * std::sin(azimuth),
           range * angles.sine[beam] + static_cast<float>(model->beams[beam].up_m),
           static_cast<float>(NumberAt<std::uint8_t>(block, at + 2))});
      const double block_s = 1e-6 * block_us * static_cast<double>(b / apart);
      scan->time_s.push_back(static_cast<float>(start_s + block_s + 1e-6 * in_block_us));
    }
  }
}

std::string VelodyneDecoder::Describe() const {
  if (model_ == nullptr) return "";
  return fmt::format("{}, {} return", model_->name, dual_ ? "dual" : "one");
}

}  // namespace lamina
