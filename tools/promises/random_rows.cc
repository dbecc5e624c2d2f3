#include "tools/promises/random_rows.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "tools/synth/engine/random.h"

namespace lamina {
namespace {

using Names = std::vector<std::string>;
using synth::HashStream;

constexpr double kWithinM = 0.10, kWithinIndoorsM = 0.05;

// What is drawn from for each of the places; a name that stands twice comes twice as often.
struct Stock {
  Names scenes, sensors, profiles;
};

const Stock& StockOf(RandomPlaces places) {
  static const Stock car = {
      {"street", "street", "city", "bays", "lorry", "carpark", "field", "tunnel"},
      {"hdl64", "os1", "os1_128", "vlp16", "mid360", "avia", "spinning", "spinning", "scattered"},
      {"constant", "constant", "constant", "start", "brake", "gaps", "picked", "shake"}};
  static const Stock foot = {
      {"forest", "pavement"},
      {"os1", "os1_128", "vlp16", "mid360", "avia", "spinning", "scattered"},
      {"constant", "constant", "start", "brake", "gaps", "picked", "spin", "shake"}};
  static const Stock indoor = {
      {"room", "room", "hall", "hall", "stairs", "glass", "corridor", "lift"},
      {"hdl64", "os1", "os1_128", "vlp16", "mid360", "mid360", "avia", "spinning", "scattered"},
      {"constant", "constant", "constant", "start", "brake", "gaps", "spin", "shake"}};
  if (places == RandomPlaces::kCar) return car;
  return places == RandomPlaces::kFoot ? foot : indoor;
}

template <typename T>
const T& OneOf(const std::vector<T>& all, HashStream* random) {
  return all[static_cast<std::size_t>(random->Index(static_cast<int>(all.size())))];
}

bool IsIn(const Names& names, const std::string& name) {
  return std::find(names.begin(), names.end(), name) != names.end();
}

// One row in the making.
class RandomRow {
 public:
  RandomRow(RandomPlaces places, std::uint64_t key) : random_(key) {
    places_ = places != RandomPlaces::kAll ? places : RandomPlaces(random_.Index(3));
    const Stock& stock = StockOf(places_);
    scene_ = OneOf(stock.scenes, &random_);
    sensor_ = OneOf(stock.sensors, &random_);
    profile_ = OneOf(stock.profiles, &random_);
    promise_.name = scene_ + "-" + sensor_ + "-" + profile_;
    Add(fmt::format("--frames 100 --seed {}", 1 + random_.Index(1000000)));
    Add(fmt::format("--scene {} --sensor {} --profile {}", scene_, sensor_, profile_));
    promise_.within_m = places_ == RandomPlaces::kIndoor ? kWithinIndoorsM : kWithinM;
    if (!IsIn({"field", "tunnel", "corridor", "lift"}, scene_)) {
      promise_.lost = promise_.degenerate = 0;
    }
    if (places_ != RandomPlaces::kCar) {
      promise_.config = sensor_ == "avia" ? "livox_avia.yaml" : "handheld.yaml";
    }
  }

  Promise Finished(int number) {
    DrawSensor();
    DrawMotion();
    DrawCompany();
    DrawWeather();
    promise_.name += fmt::format("-{:03}", number);
    return promise_;
  }

 private:
  void Add(const std::string& options) { promise_.synth.push_back(options); }
  void AddOneOf(const std::string& option, const Names& values) {
    Add(fmt::format("{} {}", option, OneOf(values, &random_)));
  }

  void DrawSensor() {
    if (sensor_ == "spinning" || sensor_ == "scattered") {
      constexpr int kLeastSteps = 150;  // in a turn
      const int rings = OneOf(std::vector<int>{16, 32, 64, 128}, &random_);
      const int points = static_cast<int>(std::pow(10.0, random_.Uniform(3.7, 5.2)));
      Add(fmt::format("--rings {} --points {}", rings, std::max(points, rings * kLeastSteps)));
    }
    if (random_.Chance(0.6)) {
      Add("--sweep");
      promise_.name += "-sweep";
    }
    AddOneOf("--noise", {"0.005", "0.01", "0.02", "0.03"});
    if (random_.Chance(0.15)) AddOneOf("--dropped-packets", {"0.05", "0.2"});
  }

  void DrawMotion() {
    if (profile_ == "gaps") {
      const bool by_car = places_ == RandomPlaces::kCar;
      AddOneOf("--gap-s", by_car ? Names{"0.3", "0.5", "1"} : Names{"0.3", "0.5"});
    }
    if (profile_ == "spin") AddOneOf("--turn-deg", {"5", "10", "15"});
    if (profile_ == "picked" && random_.Chance(0.3)) {
      Add("--untimed");
      promise_.name += "-untimed";
    }
    const bool is_road = IsIn({"street", "city", "bays", "tunnel"}, scene_);
    if (is_road && profile_ == "constant" && random_.Chance(0.5)) {
      AddOneOf("--speed", {"2", "5", "20", "28"});
    }
  }

  void DrawCompany() {
    if (IsIn({"street", "city"}, scene_) && random_.Chance(0.4)) AddOneOf("--movers", {"5", "15"});
    if (IsIn({"room", "hall"}, scene_) && random_.Chance(0.2)) AddOneOf("--movers", {"1", "3"});
  }

  void DrawWeather() {
    if (places_ == RandomPlaces::kIndoor) return;
    if (random_.Chance(0.15)) AddOneOf("--rain", {"0.03", "0.1"});
    if (places_ != RandomPlaces::kCar || !random_.Chance(0.1)) return;
    constexpr int kToFindBack = 2;  // scans
    const int scans = OneOf(std::vector<int>{5, 11}, &random_);
    Add(fmt::format("--spray 50,{}", scans));
    if (promise_.lost) promise_.lost = scans + kToFindBack;
  }

  RandomPlaces places_;
  HashStream random_;
  std::string scene_, sensor_, profile_;
  Promise promise_;
};

}  // namespace

const std::vector<std::string>& RandomPlacesNames() {
  static const std::vector<std::string> names = {"car", "foot", "indoor", "all"};
  return names;
}

std::vector<Promise> DrawPromises(int rows, int seed, RandomPlaces places) {
  std::vector<Promise> promises;
  for (int i = 0; i < rows; ++i) {
    promises.push_back(
        RandomRow(places, synth::HashOf({seed, static_cast<int>(places), i, 0x3d})).Finished(i));
  }
  return promises;
}

}  // namespace lamina
