#include "tools/synth/motion/tour.h"

#include <deque>
#include <map>
#include <optional>
#include <tuple>

#include "tools/synth/engine/random.h"

namespace lamina::synth {
namespace {

constexpr int kStepX[] = {1, 0, -1, 0}, kStepY[] = {0, 1, 0, -1};
constexpr int kTurns[] = {0, 1, -1};

// At a crossing, about to leave it in this direction.
struct Place {
  int x = 0, y = 0, quarter = 0;
  bool operator<(const Place& o) const {
    return std::tie(x, y, quarter) < std::tie(o.x, o.y, o.quarter);
  }
  bool operator==(const Place& o) const { return !(*this < o) && !(o < *this); }
};

// One block ahead, then this turn; nothing if the next block would lead out of the town.
std::optional<Place> Next(const Place& from, int turn, int size) {
  Place to{from.x + kStepX[from.quarter], from.y + kStepY[from.quarter],
           (from.quarter + turn + 4) % 4};
  const int x = to.x + kStepX[to.quarter], y = to.y + kStepY[to.quarter];
  if (x < 0 || y < 0 || x > size || y > size) return std::nullopt;
  return to;
}

// The turns of the shortest way.
std::vector<int> WayBack(const Place& from, const Place& to, int size) {
  std::map<Place, std::pair<Place, int>> came;  // from where, by which turn
  std::deque<Place> open = {from};
  while (!open.empty() && came.count(to) == 0) {
    const Place place = open.front();
    open.pop_front();
    for (const int turn : kTurns) {
      const std::optional<Place> next = Next(place, turn, size);
      if (next && came.try_emplace(*next, place, turn).second) open.push_back(*next);
    }
  }
  std::vector<int> turns;
  Place place = to;
  do {
    turns.insert(turns.begin(), came.at(place).second);
    place = came.at(place).first;
  } while (!(place == from));
  return turns;
}

}  // namespace

Tour MakeTour(int size, int blocks, std::uint64_t key) {
  HashStream random(key);
  const auto draw_start = [&] {
    return Place{random.Index(size + 1), random.Index(size + 1), random.Index(4)};
  };
  // One that a turn leads to, so that the way can begin behind it.
  Place start = draw_start();
  const auto usable = [&](const Place& place) {
    const int x = place.x + kStepX[place.quarter], y = place.y + kStepY[place.quarter];
    return x >= 0 && y >= 0 && x <= size && y <= size;
  };
  while (!usable(start)) start = draw_start();
  std::vector<int> turns;
  std::vector<Place> places = {start};
  while (static_cast<int>(turns.size()) < blocks) {
    const int turn = kTurns[random.Index(3)];
    const std::optional<Place> next = Next(places.back(), turn, size);
    if (!next) continue;
    turns.push_back(turn);
    places.push_back(*next);
  }
  for (const int turn : WayBack(places.back(), start, size)) {
    turns.push_back(turn);
    places.push_back(*Next(places.back(), turn, size));
  }
  // In a bounded town some turn is taken; the way begins behind it.
  std::size_t first = 0;
  while (turns[(first + turns.size() - 1) % turns.size()] == 0) ++first;
  Tour tour;
  tour.start = {places[first].x, places[first].y};
  tour.quarter = places[first].quarter;
  tour.legs.emplace_back();
  for (std::size_t i = 0; i < turns.size(); ++i) {
    ++tour.legs.back().blocks;
    const int turn = turns[(first + i) % turns.size()];
    if (turn == 0) continue;
    tour.legs.back().turn_after = turn;
    if (i + 1 < turns.size()) tour.legs.emplace_back();
  }
  return tour;
}

}  // namespace lamina::synth
