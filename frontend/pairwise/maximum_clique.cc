#include "frontend/pairwise/maximum_clique.h"

#include <igraph/igraph.h>

#include <algorithm>
#include <mutex>
#include <stdexcept>
#include <string>

namespace lamina {
namespace {

using Edges = std::vector<std::pair<std::size_t, std::size_t>>;

// Owns what igraph allocates.
class Graph {
 public:
  Graph(std::size_t vertices, const Edges& edges) {
    igraph_vector_int_t list;
    Require(igraph_vector_int_init(&list, static_cast<igraph_integer_t>(2 * edges.size())));
    for (std::size_t e = 0; e < edges.size(); ++e) {
      VECTOR(list)[2 * e] = static_cast<igraph_integer_t>(edges[e].first);
      VECTOR(list)[2 * e + 1] = static_cast<igraph_integer_t>(edges[e].second);
    }
    const igraph_error_t error =
        igraph_create(&graph_, &list, static_cast<igraph_integer_t>(vertices), IGRAPH_UNDIRECTED);
    igraph_vector_int_destroy(&list);
    Require(error);
  }
  ~Graph() { igraph_destroy(&graph_); }
  Graph(const Graph&) = delete;
  Graph& operator=(const Graph&) = delete;

  std::vector<std::size_t> CoreNumbers() const {
    igraph_vector_int_t cores;
    Require(igraph_vector_int_init(&cores, 0));
    const igraph_error_t error = igraph_coreness(&graph_, &cores, IGRAPH_ALL);
    std::vector<std::size_t> numbers;
    for (igraph_integer_t i = 0; i < igraph_vector_int_size(&cores); ++i) {
      numbers.push_back(static_cast<std::size_t>(VECTOR(cores)[i]));
    }
    igraph_vector_int_destroy(&cores);
    Require(error);
    return numbers;
  }

  // The largest of the first `most` maximal cliques.
  std::vector<std::size_t> LargestListed(std::size_t most) const {
    Listing listing{most, {}};
    Require(igraph_maximal_cliques_callback(&graph_, &Graph::Offer, &listing, 0, 0));
    return listing.best;
  }

 private:
  struct Listing {
    std::size_t left;
    std::vector<std::size_t> best;
  };
  static igraph_error_t Offer(const igraph_vector_int_t* clique, void* arg) {
    auto& listing = *static_cast<Listing*>(arg);
    const auto size = static_cast<std::size_t>(igraph_vector_int_size(clique));
    if (size > listing.best.size()) {
      listing.best.clear();
      for (std::size_t i = 0; i < size; ++i) {
        listing.best.push_back(static_cast<std::size_t>(VECTOR(*clique)[i]));
      }
    }
    return --listing.left == 0 ? IGRAPH_STOP : IGRAPH_SUCCESS;
  }
  static void Require(igraph_error_t error) {
    if (error != IGRAPH_SUCCESS) {
      throw std::runtime_error(std::string("igraph: ") + igraph_strerror(error));
    }
  }

  igraph_t graph_;
};

// One clique for each of the vertices of highest core number, grown by that order.
std::vector<std::size_t> GreedyClique(const std::vector<std::vector<bool>>& joined,
                                      const std::vector<std::size_t>& cores) {
  std::vector<std::size_t> order(cores.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return cores[a] > cores[b]; });
  constexpr std::size_t kStarts = 100;
  std::vector<std::size_t> best;
  for (std::size_t s = 0; s < std::min(kStarts, order.size()); ++s) {
    std::vector<std::size_t> clique = {order[s]};
    for (const std::size_t v : order) {
      const bool fits = std::all_of(clique.begin(), clique.end(),
                                    [&](std::size_t member) { return joined[v][member]; });
      if (fits) clique.push_back(v);
    }
    if (clique.size() > best.size()) best = clique;
  }
  return best;
}

}  // namespace

std::vector<std::size_t> MaximumClique(std::size_t vertices, const Edges& edges,
                                       std::size_t max_listed) {
  if (vertices == 0) return {};
  // igraph keeps its errors in globals.
  static std::mutex mutex;
  const std::lock_guard<std::mutex> lock(mutex);
  static const bool quiet = [] {
    igraph_set_error_handler(igraph_error_handler_ignore);
    return true;
  }();
  static_cast<void>(quiet);
  std::vector<std::vector<bool>> joined(vertices, std::vector<bool>(vertices));
  for (const auto& [a, b] : edges) joined.at(a).at(b) = joined.at(b).at(a) = true;
  const std::vector<std::size_t> cores = Graph(vertices, edges).CoreNumbers();
  std::vector<std::size_t> best = GreedyClique(joined, cores);
  // A clique of one more needs vertices of core number best.size() at least.
  std::vector<std::size_t> kept, number(vertices, vertices);
  for (std::size_t v = 0; v < vertices; ++v) {
    if (cores[v] < best.size()) continue;
    number[v] = kept.size();
    kept.push_back(v);
  }
  Edges left;
  for (const auto& [a, b] : edges) {
    if (number[a] < vertices && number[b] < vertices) left.emplace_back(number[a], number[b]);
  }
  if (kept.size() > best.size()) {
    std::vector<std::size_t> listed = Graph(kept.size(), left).LargestListed(max_listed);
    if (listed.size() > best.size()) {
      best.clear();
      for (const std::size_t v : listed) best.push_back(kept[v]);
    }
  }
  std::sort(best.begin(), best.end());
  return best;
}

}  // namespace lamina
