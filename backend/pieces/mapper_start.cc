// How a piece begins: what its first scans are, and what a sensor does that has rested.
#include <algorithm>
#include <utility>
#include <vector>

#include "backend/pieces/mapper.h"

namespace lamina {
namespace {

bool AtRest(const std::vector<StartScan>& scans, const SE3& T_world_lidar) {
  return std::all_of(scans.begin(), scans.end(), [&](const StartScan& scan) {
    return (scan.T_world_lidar.t - T_world_lidar.t).norm() <= RestAtStart::kRestsM &&
           RotationAngle(scan.T_world_lidar, T_world_lidar) <= RestAtStart::kRestsRad;
  });
}

}  // namespace

bool Mapper::FollowStart(const MapperScan& scan, RegisteredScan* result) {
  OdometryFrame* const frame = &result->odometry;
  // A start is followed only as long as all that its scans left in the map can be taken back.
  if (window_.full() || open_.size() < before_start_ + start_.scans().size()) start_.Clear();
  if (!start_.open()) return false;
  bool rests = AtRest(start_.scans(), frame->T_world_lidar);
  start_.Add(*frame, scan.stamp_made_up, *scan.clusters);
  if (!window_.frames().empty()) start_.ShakeFirst(window_.frames().front().sweep);
  const bool overruled = start_.overruled();
  result->start_uncertain = start_.stands();
  if (overruled) {
    StartOver(frame);
    rests = AtRest(start_.scans(), frame->T_world_lidar);
    start_.Clear();
  }
  if (overruled || (!start_.open() && rest_.over())) rest_.GoOn(rests);
  frame->match.covariance += start_.Spread(frame->T_world_lidar);
  if (start_.unsettled() && frame->status == OdometryFrame::Status::kTracked)
    frame->match.MakeDegenerate(frame->match.weakest_direction);
  return overruled;
}

bool Mapper::RestIsWhole() const {
  return !window_.frames().empty() && window_.frames().front().id == 0 &&
         open_.size() >= rest_.kept().size();
}

OdometryFrame Mapper::StartFromRest(const MapperScan& scan) {
  std::vector<RestAtStart::Kept> kept = rest_.TakeKept();
  before_start_ = open_.size() - kept.size();
  T_world_start_ = open_.Middle(before_start_).T_world_lidar;
  const std::vector<SE3> before = TakeBack();
  start_.BeginAgain();
  stretch_.Forget();
  ambiguous_.Forget();
  // SettleFirst() is for a first scan whose motion was unknown when it entered the map; this one
  // rests.
  first_settled_ = true;
  for (std::size_t k = 0; k < kept.size(); ++k) {
    MapperScan again;
    again.stamp_ns = kept[k].stamp_ns - scan.middle_ns;
    again.middle_ns = scan.middle_ns;
    again.stamp_made_up = kept[k].stamp_made_up;
    again.clusters = &kept[k].clusters;
    RegisteredScan result;
    result.odometry = Register(again);
    const bool started_over = start_.open() && FollowStart(again, &result);
    const OdometryFrame& frame = result.odometry;
    if (frame.status != OdometryFrame::Status::kLost) Accept(started_over, &result, again.clusters);
    map_->Refresh();
    if (k == 0) HangBefore(before);
    open_.Set(before.size() + k, frame.T_world_lidar, frame.sweep);
  }
  return Register(scan);
}

void Mapper::HangBefore(const std::vector<SE3>& before) {
  for (std::size_t i = 0; i < before.size(); ++i) open_.HangAnew(i, before[i]);
}

void Mapper::ClearStart() {
  start_.Clear();
  rest_.End();
}

void Mapper::DoubtRest(OdometryFrame* frame) {
  constexpr int kBelievedNoMore = 5;
  if (frame->status == OdometryFrame::Status::kLost) return;
  resting_.MoveTo(frame->T_world_lidar);
  // While the start is open, all of its scans are judged together.
  if (!resting_.Contradict() || start_.open()) return;
  frame->match.MakeDegenerate(frame->match.weakest_direction);
  if (resting_.contradictions() >= kBelievedNoMore) tracker_.odometry().Reject(frame);
}

std::vector<SE3> Mapper::TakeBack() {
  map_->Refresh();
  DropWindow();
  map_->BeginPiece(piece_);
  window_ = SlidingWindow(options_.backend.window, map_);
  tracker_.StartOver();
  std::vector<SE3> before;
  for (std::size_t i = 0; i < before_start_; ++i) before.push_back(open_.Middle(i).T_world_lidar);
  open_.ForgetKeyframes();
  // The solve under way is of poses that are taken back: its result is not to be applied.
  constexpr std::int64_t kTakenBack = -1;  // before the first keyframe
  if (!solving_.empty()) solving_ = {kTakenBack};
  keyframes_since_solve_ = frames_since_keyframe_ = 0;
  return before;
}

void Mapper::StartOver(OdometryFrame* frame) {
  const std::vector<SE3> before = TakeBack();
  const StartScan& first = start_.scans().front();
  if (before_start_ == 0) start_.Move(FirstMiddle(first.sweep) * first.T_world_lidar.Inverse());
  OdometryFrame taken;
  taken.match.degenerate_directions = start_.match().degenerate_directions;
  taken.match.degenerate_information = start_.match().degenerate_information;
  for (std::size_t k = 0; k < start_.scans().size(); ++k) {
    const StartScan& scan = start_.scans()[k];
    taken.status = k == 0 ? OdometryFrame::Status::kFirst : OdometryFrame::Status::kTracked;
    taken.stamp_ns = scan.stamp_ns;
    taken.T_world_lidar = taken.T_world_predicted = scan.T_world_lidar;
    taken.sweep = scan.sweep;
    if (k + 1 == start_.scans().size()) break;
    tracker_.odometry().Accept(scan.stamp_ns, scan.T_world_lidar);
    if (IsKeyframe(scan.T_world_lidar)) AddKeyframe(taken, scan.clusters);
    if (k == 0) HangBefore(before);
    open_.Set(before.size() + k, scan.T_world_lidar, scan.sweep);
  }
  if (start_.told_by_all()) {
    const StartScan& last = *(start_.scans().end() - 2);
    stretch_.StartOver(last.stamp_ns, last.T_world_lidar,
                       SecondsBetween(last.stamp_ns, taken.stamp_ns), StartTrack::kToldM,
                       open_.NextKeyframe());
  }
  taken.match = start_.match();
  taken.searched = true;
  *frame = taken;
}

}  // namespace lamina
