// A largest set of matches all of which agree with one another.
//
// Private to frontend/pairwise.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

namespace lamina {

// Vertices, ascending, of a largest clique of the graph on `vertices` vertices. A greedy clique
// bounds the size from below; vertices whose core number is too small for more are cut off; in what
// remains igraph lists maximal cliques (Eppstein et al. 2010). That search ends after `max_listed`
// cliques, with the largest so far: a count and not a time, so the result is the same everywhere.
// Thread-safe; calls wait for one another.
std::vector<std::size_t> MaximumClique(
    std::size_t vertices, const std::vector<std::pair<std::size_t, std::size_t>>& edges,
    std::size_t max_listed = 50000);

}  // namespace lamina
