#include "backend/session/trajectory_publisher.h"

#include <algorithm>
#include <memory>

namespace lamina {
namespace {

// Where loops correct poses, all lines are written anew, which takes longer the longer the session
// is: publications may take this part of the time.
constexpr double kMostShare = 0.05;

}  // namespace

TrajectoryPublisher::TrajectoryPublisher(const SessionFolder& folder, const Mapping* mapping,
                                         SessionLog* log)
    : folder_(folder),
      mapping_(mapping),
      log_(log),
      files_(std::make_unique<TrajectoryFiles>(folder.path())),
      thread_(LogFailure, 1) {}

void TrajectoryPublisher::PublishIfDue(std::int64_t scans, double period_s) {
  const double now_s = 1e-3 * clock_.Milliseconds();
  if (scans == published_ || now_s < due_s_ || under_way_) return;
  under_way_ = true;
  due_s_ = now_s + std::max(period_s, took_s_ / kMostShare);
  TakeInCorrections();
  const auto open = std::make_shared<std::vector<FinalPose>>();
  mapping_->ShowOpenPoses([&](const FinalPose& pose) { open->push_back(pose); });
  thread_.Do([this, open, scans] {
    const auto end = [](std::atomic<bool>* under_way) { *under_way = false; };
    const std::unique_ptr<std::atomic<bool>, decltype(end)> at_the_end(&under_way_, end);
    log_->WaitDurable();
    const Stopwatch publication;
    files_->Publish(SessionDatabase(folder_.Path("session.db"), false), scans, *open);
    published_ = scans;
    took_s_ = 1e-3 * publication.Milliseconds();
  });
}

void TrajectoryPublisher::TakeInCorrections() {
  const PieceLoops* const loops = mapping_->loops();
  if (loops == nullptr || loops->corrections() == corrections_) return;
  corrections_ = loops->corrections();
  files_.reset();  // it removes a file that the next one makes
  files_ = std::make_unique<TrajectoryFiles>(folder_.path(), loops->Corrections());
}

void TrajectoryPublisher::PublishLast(const SessionDatabase& database, std::int64_t scans,
                                      const std::vector<FinalPose>& tail) {
  TakeInCorrections();
  files_->Publish(database, scans, tail);
}

}  // namespace lamina
