// The start of a sensor that stands or sets off, perhaps together with all that is about it.
#include <algorithm>
#include <vector>

#include "frontend/start/start_track.h"

namespace lamina {
namespace {

// To which surfaces are as sharp as they are, wherever the points on them lie.
constexpr double kRoughM = 0.12;

}  // namespace

void StartTrack::Trust() {
  told_ = true;
  unsure_ = false;
  hypotheses_.clear();
  const std::vector<SE3> own = OwnPoses();
  if (!all_tracked_ || !SettingOff(own)) return Clear();
  if (scans_.size() >= kMostScans) CheckSettingOff(own);
}

bool StartTrack::SettingOff(const std::vector<SE3>& poses) const {
  // Two scans of a sensor that is faster show what stands and what moves with it as two minima, ...
  constexpr double kAtRestMS = 1.0;
  // ... and one that has become so fast has left what set off with it behind.
  constexpr double kMostMS = 5.0;
  const auto slower_than = [&](double most_m_s, std::size_t k) {
    return (poses[k].t - poses[k - 1].t).norm() < most_m_s * GapS(k);
  };
  return slower_than(kAtRestMS, 1) && slower_than(kMostMS, scans_.size() - 1);
}

StartTrack::SteadyAlong StartTrack::FindFromRest(const std::vector<SE3>& from,
                                                 double noise_m) const {
  // The mean speed of a sensor that was at rest a second ago.
  constexpr double kMostSpeedMS = 10.0;
  const Eigen::Vector3d u = LeastFaced(Faced(from, from.size() - 1));
  return FindAlong(from, u, std::min(kMostSpeedMS, steady_.most_speed_m_s), noise_m);
}

bool StartTrack::Parted(const std::vector<SE3>& poses) const {
  if (!SettingOff(poses)) return true;
  return poses.size() >= kMostScans && FindFromRest(poses, kRoughM).apart_m <= kAgreesM;
}

void StartTrack::CheckSettingOff(const std::vector<SE3>& poses) {
  // By how much two ways that are one may differ, each being found to half of that.
  constexpr double kAlikeM = 2.0 * kAgreesM;
  const std::vector<SE3> own = OwnPoses();
  const SteadyAlong fine = FindFromRest(poses, steady_.noise_m);
  const SteadyAlong rough = FindFromRest(poses, kRoughM);
  // Of a way that is none to speak of all scans are of one place, whatever else moves.
  constexpr double kStandsM = 0.3;
  const auto is_way = [](const std::vector<SE3>& way) {
    return Apart(way, std::vector<SE3>(way.size(), way.front())) >= kStandsM;
  };
  const bool stands = !is_way(own);
  // A way that is one, and as sharp as the steady motion nearest to it, is not refuted by a speed
  // that decimetres see as well, as along a row of like things. Who sets off on foot walks evenly
  // half a second later, which differs from a constant acceleration.
  const bool near =
      fine.apart_m <= kAgreesM || (fine.apart_m <= kAlikeM && fine.sharper < kLikelySigmas);
  if (near && is_way(poses) && rough.sharper < kDoubtedSigmas)
    return SameWay(poses, own) ? Clear() : TakeBest();
  if (Apart(own, fine.poses) <= kAgreesM && Apart(own, rough.poses) <= kAgreesM) {
    // What went along for a while may have drawn it aside by less than ways may differ.
    if (fine.refutes && fine.told && fine.apart_m > kSameWayM &&
        TakeSettled(fine.poses, fine.poses, fine.along)) {
      return;
    }
    // It may as well have set off with all that holds it, which is then seen from a moving sensor.
    return stands && !again_ && fine.open_speed_m_s > kKnownMS ? GiveUp() : Clear();
  }
  if (rough.apart_m <= kAgreesM && (fine.apart_m <= kAgreesM || !fine.refutes)) {
    if (SameWay(poses, own)) return Clear();
    return TakeBest();
  }
  const bool alike = Apart(fine.poses, rough.poses) <= kAlikeM;
  const bool told = alike && fine.told && rough.told && fine.refutes && rough.refutes;
  if (told && TakeSettled(fine.poses, fine.poses, fine.along)) return;
  if (again_ && stands) return Clear();
  GiveUp();
}

}  // namespace lamina
