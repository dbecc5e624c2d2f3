#include "backend/final_poses.h"

namespace lamina {

void FinalPoses::AddScan(std::size_t scan, StampNs stamp_ns, bool skipped) {
  open_.push_back({scan, stamp_ns, skipped});
}

// The skipped scans up to the next that has a pose, and that one.
void FinalPoses::Emit(const StampedPose& next, const Visit& visit) {
  const auto take = [this] {
    const Scan scan = open_.front();
    open_.pop_front();
    return scan;
  };
  while (open_.front().skipped) {
    const Scan scan = take();
    FinalPose result{
        scan.number, {scan.stamp_ns, any_ ? last_.T_world_lidar : next.T_world_lidar}, true};
    if (any_ && scan.stamp_ns > last_.stamp_ns && scan.stamp_ns < next.stamp_ns) {
      result.pose.T_world_lidar = Interpolate(last_.T_world_lidar, next.T_world_lidar,
                                              SecondsBetween(last_.stamp_ns, scan.stamp_ns) /
                                                  SecondsBetween(last_.stamp_ns, next.stamp_ns));
    }
    visit(result);
  }
  visit({take().number, next, false});
  last_ = next;
  any_ = true;
}

void FinalPoses::AddPoses(const Trajectory& poses, const Visit& visit) {
  for (const StampedPose& pose : poses) Emit(pose, visit);
}

void FinalPoses::ShowOpen(const Trajectory& open, const Visit& visit) const {
  FinalPoses rest = *this;
  rest.AddPoses(open, visit);
  for (const Scan& scan : rest.open_) {
    visit({scan.number, {scan.stamp_ns, rest.last_.T_world_lidar}, true});
  }
}

void FinalPoses::Archive(StateArchive& a) {
  open_.resize(a.Size(open_.size(), 1));
  for (Scan& scan : open_) a(&scan.number, &scan.stamp_ns, &scan.skipped);
  a(&any_, &last_);
}

}  // namespace lamina
