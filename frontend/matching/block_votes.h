// By how much one explanation of scans is better than another, each block of space having one vote.
//
// Clusters in one block are of one thing and move together: their differences D_b are summed before
// the block votes, and a vote is bounded, however near and large that thing is,
//
//     z = sum_b v_b / sqrt(sum_b v_b^2),    v_b = D_b / sqrt(1 + D_b^2),
//
// standard deviations of a sum of independent votes. Blocks are cubes of kTogetherM.
#pragma once

#include <Eigen/Core>
#include <cmath>

namespace lamina {

class BlockVotes {
 public:
  static constexpr double kTogetherM = 4.0;

  // Of one block: D_b, positive where the first explanation is better.
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

// Where the blocks that a scan meets would have the sensor, in the world, if each had one vote,
// however many clusters it has; and how many standard deviations of these votes that is from the
// pose.
struct BlockStep {
  Eigen::Vector3d step_m = Eigen::Vector3d::Zero();
  double sigmas = 0.0;
};

}  // namespace lamina
