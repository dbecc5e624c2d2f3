// What LASzip expects of the fields of points: their models for the arithmetic coder.
//
// Private to io/file.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <vector>

#include "io/file/arithmetic_coder.h"

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

// A model for each value of a byte before, made when it is wanted.
class ByteModels {
 public:
  SymbolModel* At(std::uint8_t before) {
    auto& model = models_[before];
    if (model == nullptr) model = std::make_unique<SymbolModel>(256);
    return model.get();
  }

 private:
  std::array<std::unique_ptr<SymbolModel>, 256> models_;
};

struct Point10 {
  std::int32_t x, y, z;
  std::uint16_t intensity;
  std::uint8_t returns, classification, scan_angle, user_data;
  std::uint16_t source;
};
static_assert(sizeof(Point10) == 20, "as in the file");

class Point10Model {
 public:
  explicit Point10Model(const char* first) { std::memcpy(&last_, first, sizeof(last_)); }

  template <typename Coder>
  void Code(char* bytes, Coder* coder) {
    Point10 p = last_;
    if (Coder::kEncodes) std::memcpy(&p, bytes, sizeof(p));
    CodeAttributes(&p, coder);
    CodePlace(&p, coder);
    last_ = p;
    std::memcpy(bytes, &p, sizeof(p));
  }

 private:
  // Which pulse of how many: points of one kind are predicted from one another.
  static std::size_t KindOf(std::size_t returns, std::size_t number) {
    static constexpr std::uint8_t kKinds[8][8] = {
        {15, 14, 13, 12, 11, 10, 9, 8},  {14, 0, 1, 3, 6, 10, 10, 9},
        {13, 1, 2, 4, 7, 11, 11, 10},    {12, 3, 4, 5, 8, 12, 12, 11},
        {11, 6, 7, 8, 9, 13, 13, 12},    {10, 10, 11, 12, 13, 14, 14, 13},
        {9, 10, 11, 12, 13, 14, 15, 14}, {8, 9, 10, 11, 12, 13, 14, 15}};
    return kKinds[returns][number];
  }

  template <typename Coder>
  void CodeAttributes(Point10* p, Coder* coder) {
    constexpr std::uint32_t kReturns = 32, kIntensity = 16, kClass = 8, kAngle = 4, kUser = 2,
                            kSource = 1;
    SetPulse(*p);
    std::uint32_t changed = 0;
    if (p->returns != last_.returns) changed |= kReturns;
    if (p->intensity != intensities_[kind_]) changed |= kIntensity;
    if (p->classification != last_.classification) changed |= kClass;
    if (p->scan_angle != last_.scan_angle) changed |= kAngle;
    if (p->user_data != last_.user_data) changed |= kUser;
    if (p->source != last_.source) changed |= kSource;
    changed = coder->Symbol(changed, &changed_);
    const auto byte = [&](std::uint8_t value, SymbolModel* model) {
      return static_cast<std::uint8_t>(coder->Symbol(value, model));
    };
    if ((changed & kReturns) != 0) p->returns = byte(p->returns, return_bytes_.At(last_.returns));
    SetPulse(*p);
    if ((changed & kIntensity) != 0) {
      intensities_[kind_] = static_cast<std::uint16_t>(intensity_.Code(
          intensities_[kind_], p->intensity, std::min<std::size_t>(kind_, 3), coder));
    }
    p->intensity = intensities_[kind_];
    if ((changed & kClass) != 0) {
      p->classification = byte(p->classification, classes_.At(last_.classification));
    }
    if ((changed & kAngle) != 0) {
      const auto turn = static_cast<std::uint8_t>(p->scan_angle - last_.scan_angle);
      const std::uint8_t found = byte(turn, &angles_[(p->returns >> 6) & 1U]);
      p->scan_angle = static_cast<std::uint8_t>(last_.scan_angle + found);
    }
    if ((changed & kUser) != 0) p->user_data = byte(p->user_data, users_.At(last_.user_data));
    if ((changed & kSource) != 0) {
      p->source = static_cast<std::uint16_t>(source_.Code(last_.source, p->source, 0, coder));
    }
  }

  void SetPulse(const Point10& p) {
    const std::size_t number = p.returns & 7U, returns = (p.returns >> 3) & 7U;
    kind_ = KindOf(returns, number);
    level_ = returns > number ? returns - number : number - returns;
    single_ = returns == 1 ? 1 : 0;
  }

  template <typename Coder>
  void CodePlace(Point10* p, Coder* coder) {
    // Even, so that the last bit of a context tells single pulses apart.
    const auto even = [](int bits, int most) {
      return static_cast<std::size_t>(bits < most ? bits & ~1 : most);
    };
    const std::int32_t dx = x_.Code(x_medians_[kind_].get(),
                                    Signed(Unsigned(p->x) - Unsigned(last_.x)), single_, coder);
    p->x = Signed(Unsigned(last_.x) + Unsigned(dx));
    x_medians_[kind_].Add(dx);
    const std::int32_t dy =
        y_.Code(y_medians_[kind_].get(), Signed(Unsigned(p->y) - Unsigned(last_.y)),
                single_ + even(x_.length(), 20), coder);
    p->y = Signed(Unsigned(last_.y) + Unsigned(dy));
    y_medians_[kind_].Add(dy);
    p->z =
        z_.Code(heights_[level_], p->z, single_ + even((x_.length() + y_.length()) / 2, 18), coder);
    heights_[level_] = p->z;
  }

  Point10 last_{};
  std::size_t kind_ = 0, level_ = 0, single_ = 0;
  SymbolModel changed_{64};
  ByteModels return_bytes_, classes_, users_;
  std::array<SymbolModel, 2> angles_{SymbolModel(256), SymbolModel(256)};
  NumberModel intensity_{16, 4}, source_{16, 1}, x_{32, 2}, y_{32, 22}, z_{32, 20};
  std::array<std::uint16_t, 16> intensities_{};
  std::array<MovingMedian, 16> x_medians_, y_medians_;
  std::array<std::int32_t, 8> heights_{};
};

// Times as 64-bit patterns of doubles: multiples of the last difference, in up to four sequences
// that take turns.
class GpsTimeModel {
 public:
  explicit GpsTimeModel(const char* first) { std::memcpy(&times_[0], first, sizeof(times_[0])); }

  template <typename Coder>
  void Code(char* bytes, Coder* coder) {
    std::int64_t time = 0;
    if (Coder::kEncodes) std::memcpy(&time, bytes, sizeof(time));
    // A change of sequence is coded, then the time in it.
    while (!(differences_[last_] == 0 ? CodeFirst(&time, coder) : CodeNext(&time, coder))) {
    }
    times_[last_] = time;
    std::memcpy(bytes, &time, sizeof(time));
  }

 private:
  static constexpr std::int32_t kMost = 500, kLeast = -10;
  static constexpr std::uint32_t kUnchanged = kMost - kLeast + 1, kFull = kMost - kLeast + 2,
                                 kSymbols = kMost - kLeast + 6;

  std::int64_t From(std::size_t sequence, std::int64_t time) const {
    return static_cast<std::int64_t>(static_cast<std::uint64_t>(time) -
                                     static_cast<std::uint64_t>(times_[sequence]));
  }
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
    if (Coder::kEncodes && *time != times_[last_]) {
      const std::uint32_t ahead = Ahead(*time);
      symbol = Fits(From(last_, *time)) ? 1 : ahead > 0 ? ahead + 2 : 2;
    }
    symbol = coder->Symbol(symbol, &first_);
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
    if (Coder::kEncodes && *time != times_[last_]) {
      symbol = Fits(d) ? SymbolOf(static_cast<std::int32_t>(d)) : kFull + Ahead(*time);
    }
    symbol = coder->Symbol(symbol, &multiples_);
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

  std::uint32_t last_ = 0, next_ = 0;
  std::array<std::int64_t, 4> times_{};
  std::array<std::int32_t, 4> differences_{};
  std::array<int, 4> strays_{};
  SymbolModel first_{6}, multiples_{kSymbols};
  NumberModel numbers_{32, 9};
};

}  // namespace lamina
