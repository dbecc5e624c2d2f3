// Point formats 0 to 5 in LASzip: item POINT10 of version 2.
//
// Private to io/las.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "io/las/laz_models.h"

namespace lamina {

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
  ModelsByValue return_bytes_{256}, classes_{256}, users_{256};
  std::array<SymbolModel, 2> angles_{SymbolModel(256), SymbolModel(256)};
  NumberModel intensity_{16, 4}, source_{16, 1}, x_{32, 2}, y_{32, 22}, z_{32, 20};
  std::array<std::uint16_t, 16> intensities_{};
  std::array<MovingMedian, 16> x_medians_, y_medians_;
  std::array<std::int32_t, 8> heights_{};
};

}  // namespace lamina
