// The arithmetic coder of LASzip (M. Isenburg, "LASzip: lossless compression of LiDAR data", PE&RS
// 2013; after A. Said, "FastAC"): symbols of adaptive models as a string of bytes.
//
// Encoder and decoder have the same members, so that what is coded is written down once: each call
// returns the value, which the encoder is given and the decoder finds.
//
// Private to io/las.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace lamina {

// How likely a bit is 0, by what was coded.
class BitModel {
 public:
  static constexpr int kShift = 13;
  std::uint32_t zero() const { return zero_probability_; }
  void Count(bool one);

 private:
  void Update();

  std::uint32_t zeros_ = 1, bits_ = 2, zero_probability_ = 1U << (kShift - 1);
  std::uint32_t cycle_ = 4, until_update_ = 4;
};

// How likely each of a set of symbols is.
class SymbolModel {
 public:
  static constexpr int kShift = 15;
  explicit SymbolModel(std::uint32_t symbols);
  std::uint32_t last() const { return static_cast<std::uint32_t>(counts_.size()) - 1; }
  // Of all symbols before it, in units of 2^-15.
  std::uint32_t Below(std::uint32_t symbol) const { return below_[symbol]; }
  // The last symbol for which Below() is at most so much.
  std::uint32_t SymbolAt(std::uint32_t below) const;
  void Count(std::uint32_t symbol);

 private:
  void Update();

  std::vector<std::uint32_t> counts_, below_;
  std::uint32_t total_ = 0, cycle_ = 0, until_update_ = 0;
};

class ArithmeticEncoder {
 public:
  static constexpr bool kEncodes = true;
  // Appends to `out`, which must outlive it.
  explicit ArithmeticEncoder(std::string* out) : out_(out) {}

  std::uint32_t Bit(std::uint32_t bit, BitModel* model);
  std::uint32_t Symbol(std::uint32_t symbol, SymbolModel* model);
  // Bits that are all alike likely.
  std::uint32_t Bits(std::uint32_t value, int bits);
  // After the last.
  void Finish();

 private:
  void Advance(std::uint32_t by, std::uint32_t length);
  void Renormalise();

  std::string* out_;
  std::uint32_t base_ = 0, length_ = 0xFFFFFFFF;
};

// Throws InputError, beginning with `name`, where the bytes end too early.
class ArithmeticDecoder {
 public:
  static constexpr bool kEncodes = false;
  // Both must outlive it.
  ArithmeticDecoder(std::string_view bytes, const std::string& name);

  // The values that are given make no difference.
  std::uint32_t Bit(std::uint32_t, BitModel* model);
  std::uint32_t Symbol(std::uint32_t, SymbolModel* model);
  std::uint32_t Bits(std::uint32_t, int bits);
  [[noreturn]] void FailDamaged() const;

 private:
  std::uint32_t NextByte();
  void Renormalise();

  std::string_view bytes_;
  const std::string& name_;
  std::size_t at_ = 0;
  std::uint32_t value_ = 0, length_ = 0xFFFFFFFF;
};

}  // namespace lamina
