// The start of a sensor that stands, sets off or moves, perhaps together with all objects around
// it.
#include <vector>

#include "frontend/start/start_track.h"

namespace lamina {
namespace {

// Noise at which the sharpness of a surface no longer depends on where its points fall.
constexpr double kRoughM = 0.12;

// Distance of pose k from the previous one.
double StepM(const std::vector<SE3>& poses, std::size_t k) {
  return (poses[k].t - poses[k - 1].t).norm();
}

}  // namespace

void StartTrack::Trust() {
  own_way_ = OwnWay::kUnrivalled;
  hypotheses_.clear();
  const std::vector<SE3> own = scans_.OwnPoses();
  const bool setting_off = SettingOff(own);
  // Without recorded stamps steps may be uneven, and only a sensor at rest moves steadily.
  const bool steady = setting_off || (seen_.stamps_recorded && (refuted_ || Slow(own)));
  if (!seen_.all_tracked || !steady) return Clear();
  if (!setting_off) unproven_ = false;
  const bool last = scans_.size() >= kMostScans;
  if (last && setting_off) return CheckSettingOff(own);
  const bool asked = last || scans_.size() == kFewScans || scans_.size() == kManyScans;
  if (seen_.stamps_recorded && asked) CheckGoingAlong(own, last);
}

bool StartTrack::Slow(const std::vector<SE3>& poses) const {
  constexpr double kMostMS = 5.0;
  const std::size_t last = scans_.size() - 1;
  return StepM(poses, 1) < kMostMS * scans_.GapS(1) &&
         StepM(poses, last) < kMostMS * scans_.GapS(last);
}

bool StartTrack::SettingOff(const std::vector<SE3>& poses) const {
  // At a higher speed two scans mostly show the static world and objects that move along as two
  // minima.
  constexpr double kAtRestMS = 1.0;
  return Slow(poses) && StepM(poses, 1) < kAtRestMS * scans_.GapS(1);
}

StartTrack::SteadyAlong StartTrack::FindAhead(const std::vector<SE3>& from, double noise_m,
                                              Asked asked) const {
  const Eigen::Vector3d u = LeastFaced(scans_.Faced(from, from.size() - 1));
  return FindAlong(from, u, noise_m, asked);
}

void StartTrack::CheckGoingAlong(const std::vector<SE3>& own, bool last) {
  const SteadyAlong fine = FindAhead(own, steady_.noise_m, Asked::kIfRefutes);
  // The rough search costs as much: it is made only where the fine one refutes.
  refuted_ = fine.told && fine.refutes && Refute(fine, FindAhead(own, kRoughM));
  // If odometry followed objects that move along, the static world would by then be left behind and
  // would contradict it.
  const bool told = fine.refuted && scans_.size() >= kManyScans && !SettingOff(own);
  if (!last && !told) return;
  if (!refuted_) return Clear();
  if (!TakeSettled(fine)) GiveUp();
}

void StartTrack::CheckBest() {
  const std::vector<SE3>& poses = hypotheses_.front().poses;
  if (!Slow(poses)) return TakeBest();
  const SteadyAlong fine = FindAhead(poses, steady_.noise_m);
  const auto speaks_against = [](const SteadyAlong& steady) {
    return steady.apart_m > kAgreesM && steady.sharper > kLikelySigmas;
  };
  if (!speaks_against(fine)) return TakeBest();
  const SteadyAlong rough = FindAhead(poses, kRoughM);
  if (!speaks_against(rough)) return TakeBest();
  refuted_ = true;
  if (scans_.size() < kMostScans) return;
  if (!Refute(fine, rough) || !TakeSettled(fine)) GiveUp();
}

bool StartTrack::Refute(const SteadyAlong& fine, const SteadyAlong& rough) {
  return Apart(fine.poses, rough.poses) <= kAlikeM && fine.told && rough.told && fine.refutes &&
         rough.refutes;
}

bool StartTrack::Parted(const std::vector<SE3>& poses) const {
  if (!SettingOff(poses)) return true;
  return poses.size() >= kMostScans && FindAhead(poses, kRoughM).apart_m <= kAgreesM;
}

void StartTrack::CheckSettingOff(const std::vector<SE3>& poses) {
  const std::vector<SE3> own = scans_.OwnPoses();
  const SteadyAlong fine = FindAhead(poses, steady_.noise_m, Asked::kAll);
  const SteadyAlong rough = FindAhead(poses, kRoughM);
  // Of a way that is none to speak of all scans are of one place, whatever else moves.
  const bool stands = Stands(own);
  // A way that is one, and as sharp as the steady motion nearest to it, is not refuted by a speed
  // that decimetres see as well, as along a row of like things. Who sets off on foot walks evenly
  // half a second later, which differs from a constant acceleration.
  const bool near =
      fine.apart_m <= kAgreesM || (fine.apart_m <= kAlikeM && fine.sharper < kLikelySigmas);
  if (near && !Stands(poses) && rough.sharper < kDoubtedSigmas)
    return SameWay(poses, own) ? Clear() : TakeBest();
  if (Apart(own, fine.poses) <= kAgreesM && Apart(own, rough.poses) <= kAgreesM) {
    // Objects that moved along for a while may have biased it by less than trajectories may differ.
    if (fine.refutes && fine.told && fine.apart_m > kSameWayM && TakeSettled(fine)) {
      return;
    }
    // The sensor may have started together with its surroundings; only a start that begins in
    // motion can tell.
    return stands && !after_given_up_ && fine.open_speed_m_s > kKnownMS ? GiveUp() : Clear();
  }
  if (rough.apart_m <= kAgreesM && (fine.apart_m <= kAgreesM || !fine.refutes)) {
    if (SameWay(poses, own)) return Clear();
    return TakeBest();
  }
  if (Refute(fine, rough) && TakeSettled(fine)) return;
  if (after_given_up_ && stands) return Clear();
  GiveUp();
}

}  // namespace lamina
