// What LASzip expects of numbers: the models for the arithmetic coder that its items are made of.
//
// Private to io/las.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "io/las/arithmetic_coder.h"

namespace lamina {

inline std::uint32_t Unsigned(std::int32_t value) { return static_cast<std::uint32_t>(value); }
inline std::int32_t Signed(std::uint32_t value) { return static_cast<std::int32_t>(value); }

// Whole numbers by what they differ from a prediction: the number of bits of the difference, then
// these bits. Of 16 or 32 bits, in their modular arithmetic.
class NumberModel {
 public:
  NumberModel(int bits, std::size_t contexts) : bits_(bits) {
    for (std::size_t c = 0; c < contexts; ++c) {
      lengths_.emplace_back(static_cast<std::uint32_t>(bits + 1));
    }
    for (int k = 1; k <= bits; ++k) correctors_.emplace_back(1U << std::min(k, kModelled));
  }

  // Bits of the last difference.
  int length() const { return length_; }

  template <typename Coder>
  std::int32_t Code(std::int32_t predicted, std::int32_t value, std::size_t context, Coder* coder) {
    const std::int32_t difference = Wrapped(Unsigned(value) - Unsigned(predicted));
    const std::int32_t found = Difference(difference, context, coder);
    const std::uint32_t sum = Unsigned(predicted) + Unsigned(found);
    return bits_ < 32 ? Signed(sum & ((1U << bits_) - 1U)) : Signed(sum);
  }

 private:
  static constexpr int kModelled = 8;  // the upper bits of a difference; the others are as they are

  std::int32_t Wrapped(std::uint32_t difference) const {
    if (bits_ == 32) return Signed(difference);
    const std::uint32_t range = 1U << bits_;
    const std::uint32_t within = difference & (range - 1U);
    return within >= range / 2 ? Signed(within - range) : Signed(within);
  }

  // 0 and 1 have no bits; else d in (-2^k, -2^(k-1)] or (2^(k-1), 2^k] has k.
  static int LengthOf(std::int32_t d) {
    std::uint32_t rest = d <= 0 ? 0U - Unsigned(d) : Unsigned(d) - 1U;
    int k = 0;
    for (; rest != 0; rest >>= 1) ++k;
    return k;
  }

  template <typename Coder>
  std::int32_t Difference(std::int32_t d, std::size_t context, Coder* coder) {
    length_ = static_cast<int>(
        coder->Symbol(static_cast<std::uint32_t>(LengthOf(d)), &lengths_[context]));
    if (length_ == 0) return static_cast<std::int32_t>(coder->Bit(Unsigned(d), &zero_or_one_));
    if (length_ == 32) return INT32_MIN;
    const std::uint32_t k_bits = (1U << length_) - 1U;
    std::uint32_t code = d < 0 ? Unsigned(d) + k_bits : Unsigned(d) - 1U;
    SymbolModel* model = &correctors_[static_cast<std::size_t>(length_ - 1)];
    if (length_ <= kModelled) {
      code = coder->Symbol(code & k_bits, model);
    } else {
      const int plain = length_ - kModelled;
      const std::uint32_t mask = (1U << plain) - 1U;
      const std::uint32_t upper = coder->Symbol((code & k_bits) >> plain, model);
      code = upper << plain | coder->Bits(code & mask, plain);
    }
    return code >= 1U << (length_ - 1) ? Signed(code + 1U) : Signed(code - k_bits);
  }

  const int bits_;
  int length_ = 0;
  std::vector<SymbolModel> lengths_, correctors_;
  BitModel zero_or_one_;
};

// The median of the last values, about.
class MovingMedian {
 public:
  std::int32_t get() const { return values_[2]; }
  void Add(std::int32_t v) {
    auto& m = values_;
    if (drop_high_) {
      if (v < m[2]) {
        m[4] = m[3];
        m[3] = m[2];
        const std::size_t at = v < m[0] ? 0 : v < m[1] ? 1 : 2;
        for (std::size_t i = 2; i > at; --i) m[i] = m[i - 1];
        m[at] = v;
      } else {
        if (v < m[3]) m[4] = m[3];
        m[v < m[3] ? 3 : 4] = v;
        drop_high_ = false;
      }
    } else if (m[2] < v) {
      m[0] = m[1];
      m[1] = m[2];
      const std::size_t at = m[4] < v ? 4 : m[3] < v ? 3 : 2;
      for (std::size_t i = 2; i < at; ++i) m[i] = m[i + 1];
      m[at] = v;
    } else {
      if (m[1] < v) m[0] = m[1];
      m[m[1] < v ? 1 : 0] = v;
      drop_high_ = true;
    }
  }

 private:
  std::array<std::int32_t, 5> values_{};
  bool drop_high_ = true;
};

// A model for each value before, up to 255, made when it is wanted.
class ModelsByValue {
 public:
  explicit ModelsByValue(std::uint32_t symbols) : symbols_(symbols) {}
  SymbolModel* At(std::uint32_t before) {
    auto& model = models_.at(before);
    if (model == nullptr) model = std::make_unique<SymbolModel>(symbols_);
    return model.get();
  }

 private:
  const std::uint32_t symbols_;
  std::array<std::unique_ptr<SymbolModel>, 256> models_;
};

// Times as 64-bit patterns of doubles: multiples of the last difference, in up to four sequences
// that take turns.
class GpsTimeModel {
 public:
  // Whether a time that is the same again is coded here, as in version 2 of the item, or elsewhere,
  // as in version 3, which has no symbols for it. One that is the last of another sequence is a
  // difference of 0 then.
  enum class Repeats { kCoded, kElsewhere };
  GpsTimeModel(std::int64_t first, Repeats repeats)
      : repeats_(repeats == Repeats::kCoded ? 1 : 0),
        first_(5 + repeats_),
        multiples_(kSymbols + repeats_) {
    times_[0] = first;
  }

  template <typename Coder>
  std::int64_t Code(std::int64_t time, Coder* coder) {
    // A change of sequence is coded, then the time in it. Damaged bytes can change it for ever.
    constexpr int kMostChanges = 4;
    int changes = 0;
    while (!(differences_[last_] == 0 ? CodeFirst(&time, coder) : CodeNext(&time, coder))) {
      if constexpr (!Coder::kEncodes) {
        if (++changes > kMostChanges) coder->FailDamaged();
      }
    }
    return times_[last_] = time;
  }

 private:
  static constexpr std::int32_t kMost = 500, kLeast = -10;
  // kUnchanged has no symbol if repeats are coded elsewhere; those from kFull on are one less then.
  static constexpr std::uint32_t kUnchanged = kMost - kLeast + 1, kFull = kMost - kLeast + 2,
                                 kSymbols = kMost - kLeast + 5;

  std::int64_t From(std::size_t sequence, std::int64_t time) const {
    return static_cast<std::int64_t>(static_cast<std::uint64_t>(time) -
                                     static_cast<std::uint64_t>(times_[sequence]));
  }
  bool IsRepeat(std::int64_t time) const { return repeats_ == 1 && time == times_[last_]; }
  static bool Fits(std::int64_t d) { return d == static_cast<std::int32_t>(d); }
  void Move(std::int64_t* time, std::int32_t by) const {
    *time = static_cast<std::int64_t>(static_cast<std::uint64_t>(times_[last_]) +
                                      static_cast<std::uint64_t>(static_cast<std::int64_t>(by)));
  }
  // How many sequences ahead there is one that the time is near to; 0: none.
  std::uint32_t Ahead(std::int64_t time) const {
    for (std::uint32_t i = 1; i < 4; ++i) {
      if (Fits(From((last_ + i) & 3U, time))) return i;
    }
    return 0;
  }

  // Without a difference to compare with: 0 the same time, 1 a difference, 2 a new sequence, from
  // 3 on another one. False if only the sequence was coded.
  template <typename Coder>
  bool CodeFirst(std::int64_t* time, Coder* coder) {
    std::uint32_t symbol = 0;
    if (Coder::kEncodes && !IsRepeat(*time)) {
      const std::uint32_t ahead = Ahead(*time);
      symbol = Fits(From(last_, *time)) ? 1 : ahead > 0 ? ahead + 2 : 2;
    }
    symbol = coder->Symbol(symbol - (1 - repeats_), &first_) + (1 - repeats_);
    if (symbol == 0) {
      *time = times_[last_];
    } else if (symbol == 1) {
      const std::int32_t d =
          numbers_.Code(0, static_cast<std::int32_t>(From(last_, *time)), 0, coder);
      Move(time, d);
      differences_[last_] = d;
      strays_[last_] = 0;
    } else if (symbol == 2) {
      Begin(time, coder);
    } else {
      last_ = (last_ + symbol - 2) & 3U;
      return false;
    }
    return true;
  }

  // By how many times the last difference.
  template <typename Coder>
  bool CodeNext(std::int64_t* time, Coder* coder) {
    const std::int64_t d = From(last_, *time);
    std::uint32_t symbol = kUnchanged;
    if (Coder::kEncodes && !IsRepeat(*time)) {
      symbol = Fits(d) ? SymbolOf(static_cast<std::int32_t>(d)) : kFull + Ahead(*time);
    }
    const std::uint32_t left_out = symbol < kUnchanged ? 0 : 1 - repeats_;
    symbol = coder->Symbol(symbol - left_out, &multiples_);
    if (symbol >= kUnchanged) symbol += 1 - repeats_;
    if (symbol == kUnchanged) {
      *time = times_[last_];
    } else if (symbol < kUnchanged) {
      CodeMultiple(static_cast<std::int32_t>(symbol), static_cast<std::int32_t>(d), time, coder);
    } else if (symbol == kFull) {
      Begin(time, coder);
    } else {
      last_ = (last_ + symbol - kFull) & 3U;
      return false;
    }
    return true;
  }

  std::uint32_t SymbolOf(std::int32_t d) const {
    const float ratio = static_cast<float>(d) / static_cast<float>(differences_[last_]);
    const float most = static_cast<float>(kMost), least = static_cast<float>(kLeast);
    const float clamped = std::clamp(ratio, least, most);
    const auto times = static_cast<std::int32_t>(clamped >= 0.0F ? clamped + 0.5F : clamped - 0.5F);
    const std::int32_t multiple = std::clamp(times, kLeast, kMost);
    return static_cast<std::uint32_t>(multiple >= 0 ? multiple : kMost - multiple);
  }

  template <typename Coder>
  void CodeMultiple(std::int32_t symbol, std::int32_t d, std::int64_t* time, Coder* coder) {
    const std::int32_t multiple = symbol <= kMost ? symbol : kMost - symbol;
    std::size_t context = 7;
    if (multiple == 1) {
      context = 1;
    } else if (multiple > 0) {
      context = multiple < 10 ? 2 : multiple < kMost ? 3 : 4;
    } else if (multiple < 0) {
      context = multiple > kLeast ? 5 : 6;
    }
    const auto predicted = Signed(Unsigned(multiple) * Unsigned(differences_[last_]));
    const std::int32_t found = numbers_.Code(predicted, d, context, coder);
    Move(time, found);
    const bool stray = multiple == 0 || multiple == kMost || multiple == kLeast;
    if (multiple == 1) strays_[last_] = 0;
    // After some of them the pace is another.
    constexpr int kMostStrays = 3;
    if (stray && ++strays_[last_] > kMostStrays) {
      differences_[last_] = found;
      strays_[last_] = 0;
    }
  }

  template <typename Coder>
  void Begin(std::int64_t* time, Coder* coder) {
    const auto bits = static_cast<std::uint64_t>(*time);
    const std::uint32_t upper = Unsigned(numbers_.Code(
        Signed(static_cast<std::uint32_t>(static_cast<std::uint64_t>(times_[last_]) >> 32)),
        Signed(static_cast<std::uint32_t>(bits >> 32)), 8, coder));
    const std::uint32_t low = coder->Bits(static_cast<std::uint32_t>(bits), 32);
    *time = static_cast<std::int64_t>(std::uint64_t{upper} << 32 | low);
    next_ = (next_ + 1) & 3U;
    last_ = next_;
    differences_[last_] = 0;
    strays_[last_] = 0;
  }

  const std::uint32_t repeats_;  // 1 if they are coded here
  std::uint32_t last_ = 0, next_ = 0;
  std::array<std::int64_t, 4> times_{};
  std::array<std::int32_t, 4> differences_{};
  std::array<int, 4> strays_{};
  SymbolModel first_, multiples_;
  NumberModel numbers_{32, 9};
};

}  // namespace lamina
