#include "io/packet/velodyne_packet.h"

#include <fmt/format.h>

#include <array>
#include <cmath>

#include "core/base/angle.h"
#include "core/base/error.h"
#include "io/file/byte_numbers.h"

namespace lamina {
namespace {

constexpr const VelodyneModel* kModels[] = {&kVlp16, &kVlp32c, &kHdl32e};

constexpr std::size_t kBlocks = kVelodyneBlocks, kReturns = kVelodyneReturns;
constexpr std::size_t kBlockBytes = 100, kBlockHead = 4;
constexpr std::size_t kReturnBytes = 3, kTimeAt = 1200, kModeAt = 1204, kModelAt = 1205;
constexpr std::uint8_t kDual = 0x39;
constexpr std::uint32_t kTurn = 36000;
constexpr double kUsPerHour = 3600e6;

const VelodyneModel* FindModel(std::uint8_t id) {
  for (const VelodyneModel* model : kModels) {
    if (model->id == id) return model;
  }
  return nullptr;
}

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
          (VelodyneAzimuthOf(packet, b + apart) + kTurn - VelodyneAzimuthOf(packet, b) % kTurn) %
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
      const double elevation = Radians(model.beams[i].elevation_deg);
      sine[i] = static_cast<float>(std::sin(elevation));
      cosine[i] = static_cast<float>(std::cos(elevation));
    }
  }
};

}  // namespace

std::uint16_t VelodyneFlag(std::string_view packet, std::size_t b) {
  return NumberAt<std::uint16_t>(packet, b * kBlockBytes);
}

std::uint16_t VelodyneAzimuthOf(std::string_view packet, std::size_t b) {
  return NumberAt<std::uint16_t>(packet, b * kBlockBytes + 2);
}

VelodyneReturn VelodyneReturnAt(std::string_view packet, std::size_t b, std::size_t k) {
  const std::size_t at = b * kBlockBytes + kBlockHead + k * kReturnBytes;
  return {NumberAt<std::uint16_t>(packet, at), NumberAt<std::uint8_t>(packet, at + 2)};
}

std::uint32_t VelodyneAzimuth(std::string_view packet) {
  if (packet.size() != kVelodynePacketBytes || VelodyneFlag(packet, 0) != kVelodyneFlag) {
    return kTurn;
  }
  return VelodyneAzimuthOf(packet, 0) % kTurn;
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
  if (!any_) {
    first_stamp_ns_ = stamp_ns;
    first_us_ = NumberAt<std::uint32_t>(packet, kTimeAt);
    any_ = true;
  }
  if (IsHdl64ePacket(packet)) {
    if (calibration_ == nullptr) {
      throw InputError(
          fmt::format("{}: packets of an HDL-64E, whose calibration must lie beside the capture: "
                      "under its name "
                      "with the ending .xml, or as db.xml, as it came with the sensor",
                      name));
    }
    hdl64e_ = true;
    return AddHdl64ePacket(packet, *calibration_, StartOf(packet, stamp_ns), scan);
  }
  const auto id = NumberAt<std::uint8_t>(packet, kModelAt);
  const VelodyneModel* model = FindModel(id);
  if (model == nullptr) {
    throw InputError(fmt::format(
        "{}: packets of a Velodyne sensor that is not read ({:#04x}); read are VLP-16, VLP-32C, "
        "HDL-32E and HDL-64E",
        name, id));
  }
  model_ = model;
  dual_ = NumberAt<std::uint8_t>(packet, kModeAt) == kDual;
  const double start_s = StartOf(packet, stamp_ns);
  const std::size_t apart = dual_ ? 2 : 1, firings = kReturns / model->beam_count;
  const BeamAngles angles(*model);
  const std::array<double, kBlocks> turns = TurnsOf(packet, apart);
  const double block_us = static_cast<double>(firings) * model->firing_us;
  for (std::size_t b = 0; b < kBlocks; ++b) {
    if (VelodyneFlag(packet, b) != kVelodyneFlag) continue;
    for (std::size_t k = 0; k < kReturns; ++k) {
      const auto [distance, intensity] = VelodyneReturnAt(packet, b, k);
      if (distance == 0) continue;
      // Of two equal returns of one pulse the second tells nothing.
      if (dual_ && b % 2 == 1 && VelodyneReturnAt(packet, b - 1, k).distance == distance) continue;
      const std::size_t beam = k % model->beam_count;
      const double in_block_us = static_cast<double>(k / model->beam_count) * model->firing_us +
                                 static_cast<double>(beam / model->at_once) * model->laser_us;
      const double azimuth_deg =
          0.01 * (VelodyneAzimuthOf(packet, b) + turns[b] * in_block_us / block_us) +
          model->beams[beam].azimuth_deg;
      const auto azimuth = static_cast<float>(Radians(azimuth_deg));
      const auto range = static_cast<float>(distance * model->range_unit_m);
      const float flat = range * angles.cosine[beam];
      // The azimuth grows clockwise, from the front on.
      scan->points.push_back(
          {flat * std::cos(azimuth), -flat * std::sin(azimuth),
           range * angles.sine[beam] + static_cast<float>(model->beams[beam].up_m),
           static_cast<float>(intensity)});
      const double block_s = 1e-6 * block_us * static_cast<double>(b / apart);
      scan->time_s.push_back(static_cast<float>(start_s + block_s + 1e-6 * in_block_us));
    }
  }
}

std::string VelodyneDecoder::Describe() const {
  if (hdl64e_) return "HDL-64E";
  if (model_ == nullptr) return "";
  return fmt::format("{}, {} return", model_->name, dual_ ? "dual" : "one");
}

std::optional<std::uint32_t> VelodyneSensor::PlaceOf(std::string_view packet) const {
  const std::uint32_t azimuth = VelodyneAzimuth(packet);
  if (azimuth == kTurn) return std::nullopt;
  return azimuth;
}

std::unique_ptr<SweepDecoder> VelodyneSensor::NewSweep() const {
  return std::make_unique<VelodyneDecoder>(calibration_ ? &*calibration_ : nullptr);
}

}  // namespace lamina
