// The condensed cost (backend/bundle/condensed_cost.h) of planes that lie in tiles, of keyframes
// that relative priors tie together, as the model of a trust region.
//
//     C = sum_tiles C_t + priors,    H = sum_tiles H_t + priors
//
// Each tile's cost, gradient and blocks are made by the process that has the tile, and summed in
// the order of the tiles, never in that of their arrival: the same bits at any number of
// processes. The first process alone sums H and factorises it (sparse_cholesky.h); the others learn
// the step. All learn the costs, by which all decide alike.
//
// Memory: of each process, some tiles at once; of the first, H and its factor.
//
// Private to backend/tiles.
#pragma once

#include <Eigen/SparseCore>
#include <optional>
#include <string>
#include <vector>

#include "backend/bundle/block_pattern.h"
#include "backend/bundle/solver/held_directions.h"
#include "backend/bundle/solver/sparse_cholesky.h"
#include "backend/bundle/solver/trust_region.h"
#include "backend/tiles/tiled_problem.h"

namespace lamina {

class TiledModel final : public StepModel {
 public:
  // `ties`: the keyframes' poses, priors between them and what is held; no planes. Keeps
  // references. All processes of `sharing` call each member together.
  TiledModel(const TiledProblem& problem, const BundleProblem& ties, const WorkSharing& sharing);
  ~TiledModel() override;

  bool Linearise(const std::vector<SE3>& poses) override;
  double value() const override { return value_; }
  double Value(const std::vector<SE3>& poses) const override;
  bool Solve(double radius, Eigen::VectorXd* step, double* promised) override;

  // Blocks of H on and below its diagonal that are not zero, and bytes that came from other
  // processes; of the first process.
  std::size_t blocks() const { return blocks_; }
  std::uint64_t bytes_received() const { return bytes_; }

 private:
  struct Terms;  // of a tile
  bool first() const { return sharing_.part == 0; }
  // Calls take(terms) on the first process for all tiles in their order. With `make(tile)` ->
  // Terms.
  template <typename Make, typename Take>
  void Gather(const Make& make, const Take& take);
  void FindPattern();
  void Add(const Terms& terms);
  // Exchanges what the first process has found for what all know then.
  template <typename... T>
  void Tell(T*... values) const;

  const TiledProblem& problem_;
  const BundleProblem& ties_;
  const WorkSharing& sharing_;
  HeldDirections held_;
  double value_ = 0.0;
  std::size_t blocks_ = 0;
  std::uint64_t bytes_ = 0;
  // Of the first process.
  std::optional<BlockPattern> pattern_;
  SparseCholesky cholesky_;
  Eigen::SparseMatrix<double> H_;
  Eigen::VectorXd gradient_, diagonal_;
};

}  // namespace lamina
