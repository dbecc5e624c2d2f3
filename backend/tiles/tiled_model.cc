#include "backend/tiles/tiled_model.h"

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include "backend/bundle/condensed_cost.h"
#include "backend/bundle/solver/priors.h"
#include "backend/tiles/tile_loop.h"

namespace lamina {
namespace {

std::vector<SE3> PosesOf(const std::vector<std::int32_t>& frames, const std::vector<SE3>& all) {
  std::vector<SE3> poses;
  poses.reserve(frames.size());
  for (const std::int32_t frame : frames) poses.push_back(all[static_cast<std::size_t>(frame)]);
  return poses;
}

}  // namespace

struct TiledModel::Terms {
  double cost = 0.0;
  std::vector<std::int32_t> frames;
  // For each frame: how many frames up to itself share a plane with it, and which of `frames`.
  std::vector<std::int32_t> counts, partners;
  std::vector<double> gradient;
  std::vector<double> H;  // values of the upper triangle, in the form of BlockPattern

  void Archive(StateArchive& a) { a(&cost, &frames, &counts, &partners, &gradient, &H); }

  void SetPattern(const TileProblem& tile, const BlockPattern& pattern) {
    frames = tile.frames;
    for (std::size_t f = 0; f < pattern.frames(); ++f) {
      counts.push_back(static_cast<std::int32_t>(pattern.partners(f).size()));
      partners.insert(partners.end(), pattern.partners(f).begin(), pattern.partners(f).end());
    }
  }
};

TiledModel::TiledModel(const TiledProblem& problem, const BundleProblem& ties,
                       const WorkSharing& sharing)
    : problem_(problem), ties_(ties), sharing_(sharing), held_(ties) {
  FindPattern();
}

TiledModel::~TiledModel() = default;

template <typename... T>
void TiledModel::Tell(T*... values) const {
  if (sharing_.parts <= 1) return;
  StateArchive out;
  if (first()) out(values...);
  const std::vector<std::string> all = sharing_.exchange(out.written());
  StateArchive in{std::string_view(all.front())};
  in(values...);
}

template <typename Make, typename Take>
void TiledModel::Gather(const Make& make, const Take& take) {
  const TiledClusters& tiles = problem_.tiles();
  for (std::size_t begin = 0; begin < tiles.size(); begin = tiles.BatchEnd(begin)) {
    std::vector<std::size_t> mine;
    for (std::size_t tile = begin; tile < tiles.BatchEnd(begin); ++tile) {
      if (tiles.owner(tile) == sharing_.part) mine.push_back(tile);
    }
    std::vector<Terms> made;
    ForTiles<TileProblem, Terms>(
        mine, [&](std::size_t tile) { return problem_.Read(tile); },
        [&](std::size_t, TileProblem& tile) { return make(&tile); },
        [&](std::size_t, Terms* terms) { made.push_back(std::move(*terms)); });
    std::vector<std::vector<Terms>> of_part(sharing_.parts);
    if (sharing_.parts > 1) {
      StateArchive out;
      if (!first()) out(&made);
      const std::vector<std::string> bytes = sharing_.gather(out.written());
      for (std::size_t part = 1; part < bytes.size(); ++part) {
        bytes_ += bytes[part].size();
        StateArchive in{std::string_view(bytes[part])};
        in(&of_part[part]);
      }
    }
    if (!first()) continue;
    of_part[0] = std::move(made);
    std::vector<std::size_t> next(sharing_.parts, 0);
    for (std::size_t tile = begin; tile < tiles.BatchEnd(begin); ++tile) {
      const std::size_t part = tiles.owner(tile);
      take(of_part[part].at(next[part]++));
    }
  }
}

void TiledModel::FindPattern() {
  std::vector<std::vector<std::int32_t>> partners(ties_.poses.size());
  const auto unite = [](std::vector<std::int32_t>* list) {
    std::sort(list->begin(), list->end());
    list->erase(std::unique(list->begin(), list->end()), list->end());
  };
  Gather(
      [](TileProblem* tile) {
        Terms terms;
        tile->bundle.poses.resize(tile->frames.size());
        terms.SetPattern(*tile, BlockPattern(tile->bundle, BundleIndex(tile->bundle)));
        return terms;
      },
      [&](const Terms& terms) {
        auto partner = terms.partners.begin();
        for (std::size_t f = 0; f < terms.frames.size(); ++f) {
          std::vector<std::int32_t>& list = partners[static_cast<std::size_t>(terms.frames[f])];
          for (std::int32_t i = 0; i < terms.counts[f]; ++i)
            list.push_back(terms.frames[static_cast<std::size_t>(*partner++)]);
          unite(&list);
        }
      });
  if (!first()) return;
  for (const RelativePrior& prior : ties_.priors)
    partners[static_cast<std::size_t>(std::max(prior.a, prior.b))].push_back(
        std::min(prior.a, prior.b));
  for (std::size_t f = 0; f < partners.size(); ++f) {
    partners[f].push_back(static_cast<std::int32_t>(f));
    unite(&partners[f]);
    blocks_ += partners[f].size();
  }
  pattern_.emplace(std::move(partners));
  cholesky_.Order(*pattern_);
}

void TiledModel::Add(const Terms& terms) {
  value_ += terms.cost;
  auto partner = terms.partners.begin();
  auto value = terms.H.begin();
  for (std::size_t f = 0; f < terms.frames.size(); ++f) {
    const auto frame = static_cast<std::size_t>(terms.frames[f]);
    for (int i = 0; i < 6; ++i)
      gradient_(static_cast<Eigen::Index>(6 * frame) + i) +=
          terms.gradient[6 * f + static_cast<std::size_t>(i)];
    const std::vector<std::int32_t>& all = pattern_->partners(frame);
    std::vector<std::size_t> places;
    for (std::int32_t i = 0; i < terms.counts[f]; ++i) {
      const std::int32_t other = terms.frames[static_cast<std::size_t>(*partner++)];
      places.push_back(
          static_cast<std::size_t>(std::lower_bound(all.begin(), all.end(), other) - all.begin()));
    }
    for (int c = 0; c < 6; ++c) {
      for (std::size_t i = 0; i < places.size(); ++i) {
        const int rows = i + 1 == places.size() ? c + 1 : 6;
        double* const to = &BlockPattern::Entry(frame, places[i], 0, c, &H_);
        for (int r = 0; r < rows; ++r) to[r] += *value++;
      }
    }
  }
}

bool TiledModel::Linearise(const std::vector<SE3>& poses) {
  value_ = 0.0;
  if (first()) {
    if (H_.size() == 0) H_ = pattern_->Zeros();
    std::fill(H_.valuePtr(), H_.valuePtr() + H_.nonZeros(), 0.0);
    gradient_.setZero(static_cast<Eigen::Index>(6 * poses.size()));
  }
  Gather(
      [&](TileProblem* tile) {
        Terms terms;
        tile->bundle.poses = PosesOf(tile->frames, poses);
        if (tile->frames.empty()) return terms;
        const BundleIndex index(tile->bundle);
        const BlockPattern pattern(tile->bundle, index);
        CondensedCost cost(tile->bundle);
        ReducedSystem system;
        cost.LineariseWithoutRows(tile->bundle.poses, &system);
        Eigen::SparseMatrix<double> H;
        system.AssembleInParts(tile->bundle, index, pattern, cost, ReducedSystem::kPart, &H);
        terms.SetPattern(*tile, pattern);
        terms.cost = system.cost;
        terms.gradient.assign(system.gradient.data(),
                              system.gradient.data() + system.gradient.size());
        terms.H.assign(H.valuePtr(), H.valuePtr() + H.nonZeros());
        return terms;
      },
      [&](const Terms& terms) { Add(terms); });
  bool finite = false;
  if (first()) {
    value_ += AddPriors(ties_, poses, &gradient_, &H_);
    held_.TakeOut(*pattern_, &H_);
    held_.Project(&gradient_);
    diagonal_ = DampingScale(H_.diagonal());
    finite = std::isfinite(value_) && gradient_.allFinite() && diagonal_.allFinite();
  }
  Tell(&finite, &value_);
  return finite;
}

double TiledModel::Value(const std::vector<SE3>& poses) const {
  const std::vector<double> costs = NumberOfEach<TileProblem>(
      problem_.tiles(), sharing_, [&](std::size_t tile) { return problem_.Read(tile); },
      [&](const TileProblem& tile) {
        return EigenvalueCost(tile.bundle, PosesOf(tile.frames, poses));
      });
  double sum = 0.0;
  for (const double cost : costs) sum += cost;
  return sum + PriorCost(ties_, poses);
}

bool TiledModel::Solve(double radius, Eigen::VectorXd* step, double* promised) {
  bool solved = false;
  std::vector<double> numbers(6 * ties_.poses.size(), 0.0);
  if (first()) {
    const Eigen::VectorXd damping = diagonal_ / radius;
    if (cholesky_.FactoriseDamped(*pattern_, held_, damping, &H_)) {
      const Eigen::VectorXd x = -cholesky_.Solve(gradient_);
      solved = x.allFinite();
      numbers.assign(x.data(), x.data() + x.size());
      *promised = PromisedDecrease(gradient_, x, damping);
    }
  }
  Tell(&solved, &numbers, promised);
  *step =
      Eigen::Map<const Eigen::VectorXd>(numbers.data(), static_cast<Eigen::Index>(numbers.size()));
  return solved;
}

}  // namespace lamina
