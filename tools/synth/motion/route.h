// Routes along the streets of a chequerboard town, and how a car drives along them.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

namespace lamina::synth {

enum class RouteKind {
  kWinding,   // endless, with turns to both sides; never meets itself
  kStraight,  // endless, along one street
  kLoop,      // around a number of blocks, again and again through the same places
  kTour,      // closed, through the streets of a town in both directions (tour.h)
};
// In the order of RouteKind.
const std::vector<std::string>& RouteNames();

// A point of the route's centre line.
struct RoutePoint {
  Eigen::Vector2d position;  // metres, scene frame
  double heading = 0.0;      // rad from x towards y
  double curvature = 0.0;    // d heading / ds, 1/m
};

// Position and heading beside the centre line.
struct PlanarPose {
  Eigen::Vector2d position;
  double heading = 0.0;
};

// The middle of the streets driven on, by arc length s, which may have any value. Streets lie on
// the edges of the blocks: x = i block.x or y = j block.y. A turn's curvature rises and falls
// smoothly, so heading is twice differentiable. The pattern repeats after `period_m`, up to a
// shift: memory does not depend on the length of the drive. Immutable: thread-safe.
class Route {
 public:
  // `loop_blocks` is the number of blocks along each side of a loop, or of the town that a tour
  // stays in. Tours of another key go another way.
  Route(RouteKind kind, int loop_blocks, const Eigen::Vector2d& block_size_m,
        std::uint64_t tour_key = 0);

  RoutePoint At(double s) const;
  // `offset_m` to the left of the centre line; offset_slope = d offset / ds.
  PlanarPose Beside(double s, double offset_m, double offset_slope) const;
  double period_m() const { return period_m_; }

 private:
  struct Piece {
    double begin = 0.0, length = 0.0;
    Eigen::Vector2d start;
    int quarter = 0;  // heading at the start, in quarter turns
    int turn = 0;     // +1 left, -1 right, 0 straight
  };
  void AddPiece(double length_m, int turn);

  std::vector<Piece> pieces_;
  double period_m_ = 0.0;
  Eigen::Vector2d end_ = Eigen::Vector2d::Zero();
  int end_quarter_ = 0;
  Eigen::Vector2d shift_ = Eigen::Vector2d::Zero();  // from one period to the next
  // A left turn from the origin towards +x, at equal steps of its arc length.
  std::vector<Eigen::Vector2d> turn_;
};

// Arc length as a function of time: a car that cruises at about a given speed, slows down for
// turns, and halts once in each period of the route for some seconds. Braking and acceleration are
// bounded and smooth (the profile is averaged over a window of time). Thread-safe.
class DriveProfile {
 public:
  DriveProfile(const Route& route, double cruise_m_per_s);

  double Arc(double t_s) const;           // metres, increasing
  double Speed(double t_s) const;         // m/s
  double Acceleration(double t_s) const;  // m/s^2
  double period_s() const { return period_s_; }

 private:
  struct Place {
    double periods;    // whole periods before t
    std::size_t node;  // table interval
    double u;          // place in it, [0, 1)
  };
  Place PlaceOf(double t_s) const;

  double period_m_ = 0.0, period_s_ = 0.0, step_s_ = 0.0;
  std::vector<double> arc_, speed_;  // at whole steps; one node more than intervals
};

}  // namespace lamina::synth
