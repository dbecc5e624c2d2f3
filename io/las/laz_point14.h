// Point formats 6 to 10 in LASzip: item POINT14 of version 3, whose fields lie in layers, each with
// a coder of its own (LASzip for LAS 1.4, native extension). Points of each scanner channel are
// predicted from those of the same channel.
//
// Private to io/las.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>

#include "io/las/laz_models.h"

namespace lamina {

// In the order of the file.
enum Point14Layer : std::size_t {
  kPlaceLayer,  // x and y; which other fields change
  kHeightLayer,
  kClassLayer,
  kFlagsLayer,
  kIntensityLayer,
  kAngleLayer,
  kUserLayer,
  kSourceLayer,
  kTimeLayer,
  kPoint14Layers
};

// Those of the layers that are not there are null; the fields then stay as in the first point. That
// of the places must be there.
template <typename Coder>
using Point14Coders = std::array<Coder*, kPoint14Layers>;

struct Point14 {
  static constexpr std::size_t kBytes = 30;

  std::int32_t x, y, z;
  std::uint16_t intensity;
  std::uint8_t returns;  // number in the lower four bits, number of returns above
  std::uint8_t flags;    // four of the class, two of the channel, direction, edge
  std::uint8_t classification, user_data;
  std::uint16_t scan_angle, source;
  std::int64_t time;  // the bits of a double

  static Point14 From(const char* bytes) {
    Point14 p;
    std::memcpy(&p, bytes, kTimeAt);
    std::memcpy(&p.time, bytes + kTimeAt, sizeof(p.time));
    return p;
  }
  void To(char* bytes) const {
    std::memcpy(bytes, this, kTimeAt);
    std::memcpy(bytes + kTimeAt, &time, sizeof(time));
  }

  std::uint32_t number() const { return returns & 15U; }
  std::uint32_t number_of_returns() const { return returns >> 4; }
  std::size_t channel() const { return flags >> 4 & 3U; }
  void set_channel(std::size_t c) { flags = static_cast<std::uint8_t>((flags & ~0x30U) | c << 4); }
  // All but the channel: edge, direction, four of the class.
  std::uint32_t six_flags() const { return (flags >> 6 & 3U) << 4 | (flags & 15U); }
  void set_six_flags(std::uint32_t six) {
    flags = static_cast<std::uint8_t>((flags & 0x30U) | (six >> 4) << 6 | (six & 15U));
  }

 private:
  static constexpr std::size_t kTimeAt = 22;
};

// The channel of the points before, with all that is known of it.
class Point14Channel {
 public:
  explicit Point14Channel(const Point14& first)
      : last(first), time_(first.time, GpsTimeModel::Repeats::kElsewhere) {
    heights_.fill(first.z);
    intensities_.fill(first.intensity);
  }

  // Of the number of the return; both of them: by more than one.
  static constexpr std::uint32_t kOneMore = 1, kOneLess = 2, kNumber = 3;
  // Of other fields, and of the channel.
  static constexpr std::uint32_t kReturns = 4, kAngle = 8, kTime = 16, kSource = 32, kChannel = 64;

  // Of p to the last point, but for kChannel.
  std::uint32_t ChangesTo(const Point14& p) const {
    const std::uint32_t more = (p.number() - last.number()) & 15U;
    std::uint32_t changes = more == 0 ? 0 : more == 1 ? kOneMore : more == 15 ? kOneLess : kNumber;
    if (p.number_of_returns() != last.number_of_returns()) changes |= kReturns;
    if (p.scan_angle != last.scan_angle) changes |= kAngle;
    if (p.time != last.time) changes |= kTime;
    if (p.source != last.source) changes |= kSource;
    return changes;
  }
  SymbolModel* ChangesModel() {
    const std::size_t first = last.number() == 1 ? 1 : 0;
    const std::size_t at_end = last.number() >= last.number_of_returns() ? 2 : 0;
    return &changes_[first + at_end + (time_changed_ ? 4 : 0)];
  }
  SymbolModel* ChannelModel() { return &channel_; }

  // `p` is the point in the encoder, the last one in the decoder.
  template <typename Coder>
  void Code(std::uint32_t changes, Point14* p, const Point14Coders<Coder>& coders) {
    time_changed_ = (changes & kTime) != 0;
    CodeReturns(changes, p, coders[kPlaceLayer]);
    CodePlace(p, coders);
    CodeClass(p, coders);
    CodeMeasurement(changes, p, coders);
    last = *p;
  }

  Point14 last;

 private:
  // Points whose pulses are alike are predicted from one another: by number of returns, number.
  static std::size_t KindOf(std::size_t returns, std::size_t number) {
    static constexpr const char* kKinds[16] = {
        "0123453445555555", "1013333333333333", "2124444444433333", "3345444444444444",
        "4344544444444444", "5344454444444444", "3344445444444444", "4344444544444444",
        "4344444454444444", "5344444445444444", "5344444444544444", "5334444444455444",
        "5334444444455544", "5334444444445554", "5334444444444555", "5334444444444455"};
    return static_cast<std::size_t>(kKinds[returns][number] - '0');
  }

  template <typename Coder>
  void CodeReturns(std::uint32_t changes, Point14* p, Coder* coder) {
    std::uint32_t returns = last.number_of_returns(), number = last.number();
    if ((changes & kReturns) != 0) {
      returns = coder->Symbol(p->number_of_returns(), returns_.At(returns));
    }
    if ((changes & kNumber) == kOneMore) number += 1;
    if ((changes & kNumber) == kOneLess) number += 15;
    if ((changes & kNumber) == kNumber && time_changed_) {
      number = coder->Symbol(p->number(), numbers_.At(number));
    } else if ((changes & kNumber) == kNumber) {
      number += 2 + coder->Symbol((p->number() - number - 2) & 15U, &number_steps_);
    }
    number &= 15U;
    p->returns = static_cast<std::uint8_t>(number | returns << 4);
    kind_ = KindOf(returns, number);
    level_ = std::min<std::size_t>(returns > number ? returns - number : number - returns, 7);
    single_ = returns == 1 ? 1 : 0;
    place_in_pulse_ = (number == 1 ? 2U : 0U) + (number >= returns ? 1U : 0U);
  }

  template <typename Coder>
  void CodePlace(Point14* p, const Point14Coders<Coder>& coders) {
    // Even, so that the last bit of a context tells single pulses apart.
    const auto even = [](int bits, int most) {
      return static_cast<std::size_t>(bits < most ? bits & ~1 : most);
    };
    Coder* const coder = coders[kPlaceLayer];
    const std::size_t kind = 2 * kind_ + (time_changed_ ? 1 : 0);
    const std::int32_t dx =
        x_.Code(x_medians_[kind].get(), Signed(Unsigned(p->x) - Unsigned(last.x)), single_, coder);
    p->x = Signed(Unsigned(last.x) + Unsigned(dx));
    x_medians_[kind].Add(dx);
    const std::int32_t dy =
        y_.Code(y_medians_[kind].get(), Signed(Unsigned(p->y) - Unsigned(last.y)),
                single_ + even(x_.length(), 20), coder);
    p->y = Signed(Unsigned(last.y) + Unsigned(dy));
    y_medians_[kind].Add(dy);
    if (coders[kHeightLayer] == nullptr) return;
    p->z = z_.Code(heights_[level_], p->z, single_ + even((x_.length() + y_.length()) / 2, 18),
                   coders[kHeightLayer]);
    heights_[level_] = p->z;
  }

  template <typename Coder>
  void CodeClass(Point14* p, const Point14Coders<Coder>& coders) {
    if (Coder* const coder = coders[kClassLayer]) {
      const std::uint32_t single = place_in_pulse_ == 3 ? 1 : 0;
      SymbolModel* const model = classes_.At((last.classification & 31U) << 1 | single);
      p->classification = static_cast<std::uint8_t>(coder->Symbol(p->classification, model));
    }
    if (Coder* const coder = coders[kFlagsLayer]) {
      p->set_six_flags(coder->Symbol(p->six_flags(), flags_.At(last.six_flags())));
    }
    if (Coder* const coder = coders[kUserLayer]) {
      SymbolModel* const model = users_.At(last.user_data / 4U);
      p->user_data = static_cast<std::uint8_t>(coder->Symbol(p->user_data, model));
    }
  }

  template <typename Coder>
  void CodeMeasurement(std::uint32_t changes, Point14* p, const Point14Coders<Coder>& coders) {
    if (Coder* const coder = coders[kIntensityLayer]) {
      std::uint16_t& before = intensities_[2 * place_in_pulse_ + (time_changed_ ? 1 : 0)];
      p->intensity =
          static_cast<std::uint16_t>(intensity_.Code(before, p->intensity, place_in_pulse_, coder));
      before = p->intensity;
    }
    Coder* const angle = coders[kAngleLayer];
    if (angle != nullptr && (changes & kAngle) != 0) {
      p->scan_angle = static_cast<std::uint16_t>(
          angle_.Code(last.scan_angle, p->scan_angle, time_changed_ ? 1 : 0, angle));
    }
    Coder* const source = coders[kSourceLayer];
    if (source != nullptr && (changes & kSource) != 0) {
      p->source = static_cast<std::uint16_t>(source_.Code(last.source, p->source, 0, source));
    }
    Coder* const time = coders[kTimeLayer];
    if (time != nullptr && time_changed_) p->time = time_.Code(p->time, time);
  }

  bool time_changed_ = false;
  std::size_t kind_ = 0, level_ = 0, single_ = 0, place_in_pulse_ = 0;
  std::array<SymbolModel, 8> changes_{SymbolModel(128), SymbolModel(128), SymbolModel(128),
                                      SymbolModel(128), SymbolModel(128), SymbolModel(128),
                                      SymbolModel(128), SymbolModel(128)};
  SymbolModel channel_{3}, number_steps_{13};
  ModelsByValue returns_{16}, numbers_{16}, classes_{256}, flags_{64}, users_{256};
  NumberModel x_{32, 2}, y_{32, 22}, z_{32, 20}, intensity_{16, 4}, angle_{16, 2}, source_{16, 1};
  std::array<MovingMedian, 12> x_medians_, y_medians_;
  std::array<std::int32_t, 8> heights_{};
  std::array<std::uint16_t, 8> intensities_{};
  GpsTimeModel time_;
};

class Point14Model {
 public:
  explicit Point14Model(const char* first) {
    const Point14 p = Point14::From(first);
    at_ = p.channel();
    channels_[at_] = std::make_unique<Point14Channel>(p);
  }

  template <typename Coder>
  void Code(char* bytes, const Point14Coders<Coder>& coders) {
    Coder* const coder = coders[kPlaceLayer];
    Point14 p = channels_[at_]->last;
    std::uint32_t changes = 0;
    if constexpr (Coder::kEncodes) {
      p = Point14::From(bytes);
      // What it is compared with: the last of its channel, or of any if there is none.
      const auto& same = channels_[p.channel()];
      changes = (same == nullptr ? *channels_[at_] : *same).ChangesTo(p);
      if (p.channel() != at_) changes |= Point14Channel::kChannel;
    }
    changes = coder->Symbol(changes, channels_[at_]->ChangesModel());
    if ((changes & Point14Channel::kChannel) != 0) {
      const auto ahead = static_cast<std::uint32_t>((p.channel() - at_ - 1) & 3U);
      SwitchBy(coder->Symbol(ahead, channels_[at_]->ChannelModel()) + 1);
    }
    Point14Channel& channel = *channels_[at_];
    if constexpr (!Coder::kEncodes) p = channel.last;
    channel.Code(changes, &p, coders);
    p.To(bytes);
  }

 private:
  void SwitchBy(std::uint32_t ahead) {
    const std::size_t to = (at_ + ahead) & 3U;
    if (channels_[to] == nullptr) {
      Point14 first = channels_[at_]->last;
      first.set_channel(to);
      channels_[to] = std::make_unique<Point14Channel>(first);
    }
    at_ = to;
  }

  std::size_t at_ = 0;
  std::array<std::unique_ptr<Point14Channel>, 4> channels_;
};

}  // namespace lamina
