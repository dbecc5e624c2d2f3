#include "io/las/arithmetic_coder.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/base/error.h"

namespace lamina {
namespace {

constexpr std::uint32_t kLeastLength = 1U << 24;

}  // namespace

void BitModel::Count(bool one) {
  if (!one) ++zeros_;
  if (--until_update_ == 0) Update();
}

void BitModel::Update() {
  constexpr std::uint32_t kMostBits = 1U << kShift, kMostCycle = 64;
  bits_ += cycle_;
  if (bits_ > kMostBits) {
    bits_ = (bits_ + 1) >> 1;
    zeros_ = (zeros_ + 1) >> 1;
    if (zeros_ == bits_) ++bits_;
  }
  zero_probability_ = (zeros_ * (0x80000000U / bits_)) >> (31 - kShift);
  cycle_ = std::min((5 * cycle_) >> 2, kMostCycle);
  until_update_ = cycle_;
}

SymbolModel::SymbolModel(std::uint32_t symbols) : counts_(symbols, 1), below_(symbols) {
  cycle_ = symbols;
  Update();
  cycle_ = until_update_ = (symbols + 6) >> 1;
}

void SymbolModel::Update() {
  constexpr std::uint32_t kMostCount = 1U << kShift;
  total_ += cycle_;
  if (total_ > kMostCount) {
    total_ = 0;
    for (std::uint32_t& count : counts_) total_ += count = (count + 1) >> 1;
  }
  const std::uint32_t scale = 0x80000000U / total_;
  std::uint32_t sum = 0;
  for (std::size_t s = 0; s < counts_.size(); ++s) {
    below_[s] = (scale * sum) >> (31 - kShift);
    sum += counts_[s];
  }
  const auto most = static_cast<std::uint32_t>((counts_.size() + 6) << 3);
  cycle_ = std::min((5 * cycle_) >> 2, most);
  until_update_ = cycle_;
}

std::uint32_t SymbolModel::SymbolAt(std::uint32_t below) const {
  const auto behind = std::upper_bound(below_.begin(), below_.end(), below);
  return static_cast<std::uint32_t>(behind - below_.begin()) - 1;
}

void SymbolModel::Count(std::uint32_t symbol) {
  ++counts_[symbol];
  if (--until_update_ == 0) Update();
}

void ArithmeticEncoder::Renormalise() {
  while (length_ < kLeastLength) {
    out_->push_back(static_cast<char>(base_ >> 24));
    base_ <<= 8;
    length_ <<= 8;
  }
}

// The interval becomes `length` from `by` on; where that passes 2^32, the bytes before are one
// more.
void ArithmeticEncoder::Advance(std::uint32_t by, std::uint32_t length) {
  const std::uint32_t before = base_;
  base_ += by;
  length_ = length;
  if (base_ < before) {
    std::size_t at = out_->size() - 1;
    while ((*out_)[at] == '\xFF') (*out_)[at--] = '\0';
    (*out_)[at] = static_cast<char>((*out_)[at] + 1);
  }
  Renormalise();
}

std::uint32_t ArithmeticEncoder::Bit(std::uint32_t bit, BitModel* model) {
  const std::uint32_t zero = model->zero() * (length_ >> BitModel::kShift);
  if (bit == 0) {
    Advance(0, zero);
  } else {
    Advance(zero, length_ - zero);
  }
  model->Count(bit != 0);
  return bit;
}

std::uint32_t ArithmeticEncoder::Symbol(std::uint32_t symbol, SymbolModel* model) {
  const std::uint32_t unit = length_ >> SymbolModel::kShift;
  const std::uint32_t below = model->Below(symbol) * unit;
  const std::uint32_t end = symbol == model->last() ? length_ : model->Below(symbol + 1) * unit;
  Advance(below, end - below);
  model->Count(symbol);
  return symbol;
}

std::uint32_t ArithmeticEncoder::Bits(std::uint32_t value, int bits) {
  constexpr int kMost = 19, kHalf = 16;
  std::uint32_t left = value;
  if (bits > kMost) {
    Bits(left & 0xFFFFU, kHalf);
    left >>= kHalf;
    bits -= kHalf;
  }
  const std::uint32_t unit = length_ >> bits;
  Advance(left * unit, unit);
  return value;
}

void ArithmeticEncoder::Finish() {
  const bool long_end = length_ > 2 * kLeastLength;
  if (long_end) {
    Advance(kLeastLength, kLeastLength >> 1);
  } else {
    Advance(kLeastLength >> 1, kLeastLength >> 9);
  }
  out_->append(long_end ? 3 : 2, '\0');
}

ArithmeticDecoder::ArithmeticDecoder(std::string_view bytes, const std::string& name)
    : bytes_(bytes), name_(name) {
  for (int i = 0; i < 4; ++i) value_ = value_ << 8 | NextByte();
}

std::uint32_t ArithmeticDecoder::NextByte() {
  if (at_ >= bytes_.size()) throw InputError(fmt::format("{}: compressed points end early", name_));
  return static_cast<unsigned char>(bytes_[at_++]);
}

void ArithmeticDecoder::FailDamaged() const {
  throw InputError(fmt::format("{}: compressed points are damaged", name_));
}

void ArithmeticDecoder::Renormalise() {
  while (length_ < kLeastLength) {
    value_ = value_ << 8 | NextByte();
    // Damaged bytes can leave nothing of the interval.
    if (length_ == 0) FailDamaged();
    length_ <<= 8;
  }
}

std::uint32_t ArithmeticDecoder::Bit(std::uint32_t, BitModel* model) {
  const std::uint32_t zero = model->zero() * (length_ >> BitModel::kShift);
  const bool one = value_ >= zero;
  if (one) value_ -= zero;
  length_ = one ? length_ - zero : zero;
  Renormalise();
  model->Count(one);
  return one ? 1 : 0;
}

std::uint32_t ArithmeticDecoder::Symbol(std::uint32_t, SymbolModel* model) {
  const std::uint32_t unit = length_ >> SymbolModel::kShift;
  const std::uint32_t symbol = model->SymbolAt(value_ / unit);
  const std::uint32_t below = model->Below(symbol) * unit;
  const std::uint32_t end = symbol == model->last() ? length_ : model->Below(symbol + 1) * unit;
  value_ -= below;
  length_ = end - below;
  Renormalise();
  model->Count(symbol);
  return symbol;
}

std::uint32_t ArithmeticDecoder::Bits(std::uint32_t, int bits) {
  constexpr int kMost = 19, kHalf = 16;
  std::uint32_t low = 0;
  const bool in_two = bits > kMost;
  if (in_two) {
    low = Bits(0, kHalf);
    bits -= kHalf;
  }
  const std::uint32_t unit = length_ >> bits;
  const std::uint32_t value = value_ / unit;
  value_ -= unit * value;
  length_ = unit;
  Renormalise();
  return in_two ? value << kHalf | low : value;
}

}  // namespace lamina
