// Work on tiles that are read from disk, some at once.
//
// Private to backend/tiles.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "backend/tiles/tiled_clusters.h"
#include "core/base/parallel.h"

namespace lamina {

// Calls read(tile), which returns an Input, for each of these tiles in their order; work(tile,
// input), which returns a Result, several at once; and take(tile, &result) in their order again. At
// most kTilesAtOnce are in memory.
template <typename Input, typename Result, typename Read, typename Work, typename Take>
void ForTiles(const std::vector<std::size_t>& tiles, const Read& read, const Work& work,
              const Take& take) {
  constexpr std::size_t kTilesAtOnce = 4;
  std::vector<Input> inputs(kTilesAtOnce);
  std::vector<Result> results(kTilesAtOnce);
  for (std::size_t begin = 0; begin < tiles.size(); begin += kTilesAtOnce) {
    const std::size_t count = std::min(kTilesAtOnce, tiles.size() - begin);
    for (std::size_t i = 0; i < count; ++i) inputs[i] = read(tiles[begin + i]);
    ParallelChunks(count, 1, [&](std::size_t i, std::size_t) {
      results[i] = work(tiles[begin + i], inputs[i]);
      inputs[i] = Input();
    });
    for (std::size_t i = 0; i < count; ++i) take(tiles[begin + i], &results[i]);
  }
}

// work(input) of every tile, in their order, in all processes: each reads and works on its own.
template <typename Input, typename Read, typename Work>
std::vector<double> NumberOfEach(const TiledClusters& tiles, const WorkSharing& sharing,
                                 const Read& read, const Work& work) {
  return ShareOut<double>(tiles.owners(), sharing, [&](const std::vector<std::size_t>& mine) {
    std::vector<double> found;
    ForTiles<Input, double>(
        mine, read, [&](std::size_t, const Input& input) { return work(input); },
        [&](std::size_t, const double* number) { found.push_back(*number); });
    return found;
  });
}

}  // namespace lamina
