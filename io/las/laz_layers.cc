#include "io/las/laz_layers.h"

#include <fmt/format.h>

#include <array>
#include <cstring>
#include <optional>

#include "core/base/error.h"
#include "io/file/byte_numbers.h"
#include "io/las/arithmetic_coder.h"
#include "io/las/laz_point14.h"

namespace lamina {
namespace {

void PutLength(std::size_t length, std::string* bytes) {
  AppendNumber(static_cast<std::uint32_t>(length), bytes);
}

std::size_t LayersOf(const LazItem& item) {
  switch (item.type) {
    case kLazPoint14:
      return kPoint14Layers;
    case kLazRgbNir14:
      return 2;
    case kLazByte14:
      return item.bytes;
    default:
      return 1;
  }
}

// Layers that tell something: of fields of which not all are as in the first point.
std::array<bool, kPoint14Layers> LayersWanted(std::string_view records) {
  const Point14 first = Point14::From(records.data());
  std::array<bool, kPoint14Layers> wanted{};
  wanted[kPlaceLayer] = true;
  for (std::size_t at = 0; at < records.size(); at += Point14::kBytes) {
    const Point14 p = Point14::From(records.data() + at);
    const auto want = [&wanted](Point14Layer layer, bool differs) {
      wanted[layer] = wanted[layer] || differs;
    };
    want(kHeightLayer, p.z != first.z);
    want(kClassLayer, p.classification != first.classification);
    want(kFlagsLayer, p.six_flags() != first.six_flags());
    want(kIntensityLayer, p.intensity != first.intensity);
    want(kAngleLayer, p.scan_angle != first.scan_angle);
    want(kUserLayer, p.user_data != first.user_data);
    want(kSourceLayer, p.source != first.source);
    want(kTimeLayer, p.time != first.time);
  }
  return wanted;
}

}  // namespace

std::string PackLayeredChunk(std::string_view records) {
  const std::array<bool, kPoint14Layers> wanted = LayersWanted(records);
  std::array<std::string, kPoint14Layers> layers;
  std::array<std::optional<ArithmeticEncoder>, kPoint14Layers> encoders;
  Point14Coders<ArithmeticEncoder> coders{};
  for (std::size_t i = 0; i < kPoint14Layers; ++i) {
    if (wanted[i]) coders[i] = &encoders[i].emplace(&layers[i]);
  }
  Point14Model model(records.data());
  char record[Point14::kBytes];
  for (std::size_t at = Point14::kBytes; at < records.size(); at += Point14::kBytes) {
    std::memcpy(record, records.data() + at, Point14::kBytes);
    model.Code(record, coders);
  }
  for (auto& encoder : encoders) {
    if (encoder) encoder->Finish();
  }
  std::string chunk(records.substr(0, Point14::kBytes));
  PutLength(records.size() / Point14::kBytes, &chunk);
  for (const std::string& layer : layers) PutLength(layer.size(), &chunk);
  for (const std::string& layer : layers) chunk += layer;
  return chunk;
}

void UnpackLayeredChunk(const LazLayout& layout, std::string_view chunk, std::uint64_t points,
                        const std::string& name, const LazVisitor& visit) {
  const auto fail = [&](const std::string& what) {
    throw InputError(fmt::format("{}: {}", name, what));
  };
  std::string record(chunk.substr(0, layout.record_bytes()));
  std::size_t at = record.size(), layer_count = 0;
  for (const LazItem& item : layout.items) layer_count += LayersOf(item);
  if ((chunk.size() - at) / sizeof(std::uint32_t) < 1 + layer_count) {
    fail("compressed points end early");
  }
  const auto next = [&chunk, &at] {
    at += sizeof(std::uint32_t);
    return NumberAt<std::uint32_t>(chunk, at - sizeof(std::uint32_t));
  };
  if (const std::uint32_t found = next(); found != points) {
    fail(fmt::format("a chunk of {} compressed points, {} wanted", found, points));
  }
  std::array<std::size_t, kPoint14Layers> lengths{};
  for (std::size_t& length : lengths) length = next();
  at += (layer_count - kPoint14Layers) * sizeof(std::uint32_t);

  std::array<std::optional<ArithmeticDecoder>, kPoint14Layers> decoders;
  Point14Coders<ArithmeticDecoder> coders{};
  for (std::size_t i = 0; i < kPoint14Layers; ++i) {
    if (lengths[i] > chunk.size() - at) fail("a layer of compressed points is cut off");
    if (lengths[i] > 0) coders[i] = &decoders[i].emplace(chunk.substr(at, lengths[i]), name);
    at += lengths[i];
  }
  std::memset(record.data() + Point14::kBytes, 0, record.size() - Point14::kBytes);
  visit(record);
  if (points < 2) return;
  if (coders[kPlaceLayer] == nullptr) fail("compressed points lack their places");
  Point14Model model(record.data());
  for (std::uint64_t i = 1; i < points; ++i) {
    model.Code(record.data(), coders);
    visit(record);
  }
}

}  // namespace lamina
