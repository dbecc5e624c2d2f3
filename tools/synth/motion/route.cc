#include "tools/synth/motion/route.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>

#include "tools/synth/motion/tour.h"

namespace lamina::synth {
namespace {

constexpr double kTurnLength = 20.0;
constexpr double kRamp = 0.3;  // share of a turn over which curvature rises, and falls
constexpr int kTurnSteps = 200;

double Smoothstep(double u) { return u * u * (3.0 - 2.0 * u); }
// Integral of Smoothstep from 0.
double SmoothstepArea(double u) { return u * u * u * (1.0 - 0.5 * u); }

// Curvature of a left turn over its plateau value, u in [0, 1]. Its integral is 1 - kRamp.
double TurnShape(double u) { return Smoothstep(std::min({1.0, u / kRamp, (1.0 - u) / kRamp})); }

double TurnShapeArea(double u) {
  if (u < kRamp) return kRamp * SmoothstepArea(u / kRamp);
  if (u <= 1.0 - kRamp) return u - 0.5 * kRamp;
  return 1.0 - kRamp - kRamp * SmoothstepArea((1.0 - u) / kRamp);
}

double TurnHeading(double u) { return 0.5 * M_PI * TurnShapeArea(u) / (1.0 - kRamp); }

Eigen::Vector2d Rotated(const Eigen::Vector2d& v, int quarters) {
  switch (((quarters % 4) + 4) % 4) {
    case 0:
      return v;
    case 1:
      return {-v.y(), v.x()};
    case 2:
      return -v;
    default:
      return {v.y(), -v.x()};
  }
}

std::vector<Eigen::Vector2d> IntegrateTurn() {
  constexpr int kSubsteps = 16;
  constexpr double kStep = 1.0 / (kTurnSteps * kSubsteps);
  std::vector<Eigen::Vector2d> turn = {Eigen::Vector2d::Zero()};
  Eigen::Vector2d p = Eigen::Vector2d::Zero();
  for (int i = 0; i < kTurnSteps * kSubsteps; ++i) {
    const double heading = TurnHeading((i + 0.5) * kStep);
    p += kTurnLength * kStep * Eigen::Vector2d(std::cos(heading), std::sin(heading));
    if ((i + 1) % kSubsteps == 0) turn.push_back(p);
  }
  return turn;
}

// Cubic with values and slopes (per unit of u) at both ends.
template <typename T>
T Hermite(const T& p0, const T& m0, const T& p1, const T& m1, double u) {
  const double v = 1.0 - u;
  return (v * v * (1.0 + 2.0 * u)) * p0 + (u * v * v) * m0 + (u * u * (1.0 + 2.0 * v)) * p1 -
         (u * u * v) * m1;
}

// Blocks of a tour for each one of the town, and at most.
constexpr int kTourFactor = 4, kTourMost = 400;

std::vector<RouteLeg> LegsOf(RouteKind kind, int loop_blocks) {
  switch (kind) {
    case RouteKind::kStraight:
      return {{4, 0}};
    case RouteKind::kLoop:
      return std::vector<RouteLeg>(4, {loop_blocks, 1});
    default:
      return {{2, 1}, {2, -1}, {1, -1}, {2, 1}};
  }
}

}  // namespace

const std::vector<std::string>& RouteNames() {
  static const std::vector<std::string> names = {"winding", "straight", "loop", "tour"};
  return names;
}

Route::Route(RouteKind kind, int loop_blocks, const Eigen::Vector2d& block_size_m,
             std::uint64_t tour_key)
    : turn_(IntegrateTurn()) {
  std::vector<RouteLeg> legs;
  if (kind == RouteKind::kTour) {
    const int blocks = std::min(kTourMost, kTourFactor * (loop_blocks + 1) * (loop_blocks + 1));
    const Tour tour = MakeTour(loop_blocks, blocks, tour_key);
    legs = tour.legs;
    end_ = tour.start.cast<double>().cwiseProduct(block_size_m);
    end_quarter_ = tour.quarter;
  } else {
    legs = LegsOf(kind, loop_blocks);
  }
  // A turn begins this far before the crossing and ends as far behind.
  const double tangent = turn_.back().x();
  if (legs.front().turn_after != 0) end_ += Rotated({tangent, 0.0}, end_quarter_);
  for (const RouteLeg& leg : legs) {
    const double pitch = end_quarter_ % 2 == 0 ? block_size_m.x() : block_size_m.y();
    AddPiece(leg.blocks * pitch - (leg.turn_after != 0 ? 2.0 * tangent : 0.0), 0);
    if (leg.turn_after != 0) AddPiece(kTurnLength, leg.turn_after);
  }
  shift_ = end_ - pieces_.front().start;
}

void Route::AddPiece(double length_m, int turn) {
  pieces_.push_back({period_m_, length_m, end_, end_quarter_, turn});
  period_m_ += length_m;
  const Eigen::Vector2d& arc = turn_.back();
  const Eigen::Vector2d step =
      turn == 0 ? Eigen::Vector2d(length_m, 0.0) : Eigen::Vector2d(arc.x(), turn * arc.y());
  end_ += Rotated(step, end_quarter_);
  end_quarter_ += turn;
}

RoutePoint Route::At(double s) const {
  const double periods = std::floor(s / period_m_);
  const double rest = s - periods * period_m_;
  std::size_t i = pieces_.size() - 1;
  while (i > 0 && pieces_[i].begin > rest) --i;
  const Piece& piece = pieces_[i];
  const double along = rest - piece.begin;
  RoutePoint point;
  point.heading = 0.5 * M_PI * piece.quarter;
  Eigen::Vector2d local(along, 0.0);
  if (piece.turn != 0) {
    const double u = std::clamp(along / piece.length, 0.0, 1.0);
    point.heading += piece.turn * TurnHeading(u);
    point.curvature = piece.turn * TurnShape(u) * 0.5 * M_PI / ((1.0 - kRamp) * piece.length);
    const double place = std::min(u * kTurnSteps, kTurnSteps - 1e-9);
    const auto node = static_cast<std::size_t>(place);
    const double step = kTurnLength / kTurnSteps;
    const auto slope = [&](std::size_t k) {
      const double heading = TurnHeading(static_cast<double>(k) / kTurnSteps);
      return Eigen::Vector2d(step * std::cos(heading), step * std::sin(heading));
    };
    local = Hermite<Eigen::Vector2d>(turn_[node], slope(node), turn_[node + 1], slope(node + 1),
                                     place - static_cast<double>(node));
    local.y() *= piece.turn;
  }
  point.position = piece.start + periods * shift_ + Rotated(local, piece.quarter);
  return point;
}

PlanarPose Route::Beside(double s, double offset_m, double offset_slope) const {
  const RoutePoint p = At(s);
  const Eigen::Vector2d left(-std::sin(p.heading), std::cos(p.heading));
  return {p.position + offset_m * left,
          p.heading + std::atan2(offset_slope, 1.0 - p.curvature * offset_m)};
}

namespace {

constexpr double kNodeStep = 0.25;        // metres between the nodes of the speed profile
constexpr double kTableStep = 0.05;       // seconds
constexpr double kSmoothing = 1.2;        // seconds, width of the averaging window
constexpr double kAcceleration = 1.6;     // m/s^2
constexpr double kRouteBraking = 2.0;     // m/s^2
constexpr double kSidewaysComfort = 2.4;  // m/s^2
constexpr double kHalt = 3.0;             // seconds
constexpr double kHaltPlace = 0.37;       // share of the route's period

// The jerky drive, before averaging: times at equal steps of arc length, halts included.
struct RawDrive {
  double node_m;
  std::vector<double> time, speed;
  std::size_t halt;

  double Arc(double t) const {
    const auto next = std::upper_bound(time.begin(), time.end(), t);
    const auto i = static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(
        next - time.begin() - 1, 0, static_cast<std::ptrdiff_t>(time.size()) - 2));
    double left = time[i + 1] - t;
    double speed_left = speed[i + 1];
    // Constant acceleration between two nodes; after the halt it starts from rest, at the end of
    // the waiting time.
    const double moving = 2.0 * node_m / (speed[i] + speed[i + 1]);
    left = std::min(left, moving);
    const double acceleration = (speed[i + 1] - speed[i]) / moving;
    return node_m * static_cast<double>(i + 1) - left * speed_left +
           0.5 * acceleration * left * left;
  }
};

RawDrive MakeRawDrive(const Route& route, double cruise) {
  const auto nodes = static_cast<std::size_t>(std::ceil(route.period_m() / kNodeStep));
  RawDrive drive;
  drive.node_m = route.period_m() / static_cast<double>(nodes);
  drive.halt = static_cast<std::size_t>(kHaltPlace * static_cast<double>(nodes));
  std::vector<double> speed(nodes);
  for (std::size_t i = 0; i < nodes; ++i) {
    const double s = drive.node_m * static_cast<double>(i);
    const double wave = 1.0 + 0.12 * std::sin(2.0 * M_PI * 3.0 * s / route.period_m());
    const double curvature = std::abs(route.At(s).curvature);
    speed[i] = std::min(cruise * wave, std::sqrt(kSidewaysComfort / std::max(curvature, 1e-9)));
  }
  speed[drive.halt] = 0.0;
  // v^2 changes by at most 2 a ds between nodes; twice around, since the profile is periodic.
  const double gain = 2.0 * kAcceleration * drive.node_m;
  const double loss = 2.0 * kRouteBraking * drive.node_m;
  for (std::size_t k = 0; k < 2 * nodes; ++k) {
    const double before = speed[k % nodes];
    double& next = speed[(k + 1) % nodes];
    next = std::min(next, std::sqrt(before * before + gain));
  }
  for (std::size_t k = 2 * nodes; k > 0; --k) {
    const double after = speed[k % nodes];
    double& here = speed[(k - 1) % nodes];
    here = std::min(here, std::sqrt(after * after + loss));
  }
  speed.push_back(speed.front());
  drive.time = {0.0};
  for (std::size_t i = 0; i < nodes; ++i) {
    const double moving = 2.0 * drive.node_m / (speed[i] + speed[i + 1]);
    drive.time.push_back(drive.time.back() + moving + (i == drive.halt ? kHalt : 0.0));
  }
  drive.speed = std::move(speed);
  return drive;
}

}  // namespace

DriveProfile::DriveProfile(const Route& route, double cruise_m_per_s)
    : period_m_(route.period_m()) {
  const RawDrive raw = MakeRawDrive(route, cruise_m_per_s);
  period_s_ = raw.time.back();
  const auto intervals = static_cast<std::size_t>(std::ceil(period_s_ / kTableStep));
  step_s_ = period_s_ / static_cast<double>(intervals);
  const auto raw_arc = [&](double t) {
    const double periods = std::floor(t / period_s_);
    return periods * period_m_ + raw.Arc(t - periods * period_s_);
  };
  // s(t) = integral of w(x) raw(t - x) dx with w = (1 + cos(2 pi x / W)) / W, |x| < W / 2; the
  // speed by the derivative of w, so that the two agree.
  constexpr int kSamples = 96;
  for (std::size_t node = 0; node <= intervals; ++node) {
    const double t = step_s_ * static_cast<double>(node);
    double arc = 0.0;
    double speed = 0.0;
    for (int k = 0; k < kSamples; ++k) {
      const double phase = (k + 0.5) / kSamples - 0.5;
      const double s = raw_arc(t - kSmoothing * phase);
      arc += (1.0 + std::cos(2.0 * M_PI * phase)) / kSamples * s;
      speed -= 2.0 * M_PI * std::sin(2.0 * M_PI * phase) / (kSmoothing * kSamples) * s;
    }
    arc_.push_back(arc);
    speed_.push_back(std::max(0.0, speed));
  }
  arc_.back() = arc_.front() + period_m_;
  speed_.back() = speed_.front();
}

DriveProfile::Place DriveProfile::PlaceOf(double t_s) const {
  const double periods = std::floor(t_s / period_s_);
  const double place = std::clamp((t_s - periods * period_s_) / step_s_, 0.0,
                                  static_cast<double>(arc_.size() - 1) - 1e-9);
  const double node = std::floor(place);
  return {periods, static_cast<std::size_t>(node), place - node};
}

double DriveProfile::Arc(double t_s) const {
  const Place p = PlaceOf(t_s);
  return p.periods * period_m_ + Hermite(arc_[p.node], step_s_ * speed_[p.node], arc_[p.node + 1],
                                         step_s_ * speed_[p.node + 1], p.u);
}

double DriveProfile::Speed(double t_s) const {
  const Place p = PlaceOf(t_s);
  return (1.0 - p.u) * speed_[p.node] + p.u * speed_[p.node + 1];
}

double DriveProfile::Acceleration(double t_s) const {
  // Centred over one step: continuous, unlike the slope of the table.
  return (Speed(t_s + 0.5 * step_s_) - Speed(t_s - 0.5 * step_s_)) / step_s_;
}

}  // namespace lamina::synth
