// By how much one explanation of scans is better than another, each block of space having one vote.
//
// Clusters in one block are of one thing and move together: their differences D_b are summed before
// the block votes, and a vote is bounded, however near and large that thing is,
//
//     z = sum_b v_b / sqrt(sum_b v_b^2),    v_b = D_b / sqrt(1 + D_b^2),
//
// standard deviations of a sum of independent votes. Blocks are cubes of 4 m.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <vector>

#include "core/map/voxel_key.h"

namespace lamina {

// Key of the block in which p lies.
inline VoxelKey BlockAround(const Eigen::Vector3d& p) {
  constexpr double kTogetherM = 4.0;
  return VoxelKeyOf(p, 1.0 / kTogetherM);
}

// Information, 1/m^2, with which a block has half its vote: that of a residual of 5 cm.
constexpr double kHalfVoteInformation = 400.0;

class BlockVotes {
 public:
  // Adds the vote of one block by its D_b, positive where the first explanation is better.
  void Add(double difference) {
    const double vote = difference / std::hypot(1.0, difference);
    sum_ += vote;
    squares_ += vote * vote;
  }
  // z; 0 where no block makes a difference.
  double Sigmas() const { return squares_ > 0.0 ? sum_ / std::sqrt(squares_) : 0.0; }

 private:
  double sum_ = 0.0, squares_ = 0.0;
};

// What both have to say, as a signed square of standard deviations: z of the votes, and by how much
// the other explanation is the unlikelier one beside them, as squared standard deviations.
inline double ClearSquared(double z, double unlikelier) { return z * std::abs(z) + unlikelier; }

// The D_b of clusters that come one by one.
class BlockDifferences {
 public:
  void Add(const Eigen::Vector3d& p, double difference) {
    index_.Gather(BlockAround(p), &differences_) += difference;
  }
  // z.
  double Sigmas() const {
    BlockVotes votes;
    for (const double difference : differences_) votes.Add(difference);
    return votes.Sigmas();
  }

 private:
  VoxelIndex index_{64};
  std::vector<double> differences_;
};

// The step of the sensor, in the world, that the blocks met by a scan lead to if each has one vote,
// however many clusters it has; and its length in standard deviations of these votes.
struct BlockStep {
  Eigen::Vector3d step_m = Eigen::Vector3d::Zero();
  double sigmas = 0.0;
};

}  // namespace lamina
