#include "backend/loops/loop_track.h"

#include <algorithm>
#include <utility>

namespace lamina {
namespace {

// The map stays as it is while nothing in reach has moved farther than this, some share of a
// plane's thickness.
constexpr double kMovedM = 0.01, kMovedRad = 2e-4;

}  // namespace

LoopTrack::LoopTrack(const LoopOptions& options, const VoxelMapOptions& map,
                     const ScanMatcherOptions& matcher, ByteStore* store)
    : options_(options),
      map_(map),
      store_(store),
      builder_(options.submap, map.LeafSize()),
      closure_(options, map, matcher, store) {}

void LoopTrack::Add(const FinalKeyframe& keyframe) {
  sensor_ = keyframe.T_world_lidar.t;
  last_ns_ = keyframe.stamp_ns;
  ++keyframes_since_begin_;
  if (auto submap = builder_.Add(keyframe)) Complete(std::move(*submap));
}

void LoopTrack::Complete(Submap submap) {
  if (store_ != nullptr) submap.StoreIn(store_);
  complete_.push_back(std::move(submap));
}

std::optional<std::vector<VoxelMap::FixedPart>> LoopTrack::Advance() {
  std::optional<std::vector<VoxelMap::FixedPart>> parts;
  if (under_way_ &&
      (!complete_.empty() || keyframes_since_begin_ >= options_.hand_over_lag_keyframes)) {
    background_.Wait();
    const bool exchange = outcome_.exchange;
    std::vector<VoxelMap::FixedPart> taken = TakeIn();
    if (exchange) parts = std::move(taken);
  }
  if (!complete_.empty()) Begin();
  return parts;
}

void LoopTrack::Begin() {
  under_way_ = true;
  keyframes_since_begin_ = 0;
  working_on_ = std::exchange(complete_, {});
  sensor_at_begin_ = sensor_;
  background_.Start([this] {
    for (Submap& submap : working_on_) closure_.Add(std::move(submap));
    Settle();
  });
}

// What the anchors as they are now change in the map.
void LoopTrack::Settle() {
  outcome_ = Outcome();
  if (!closure_.corrected()) return;
  const Submap& newest = closure_.submaps().back();
  outcome_.T_map_world = closure_.anchors().back() * newest.T_world_submap.Inverse();
  outcome_.correction.emplace(closure_.submaps(), closure_.anchors(), closure_.trimmed());
  const std::vector<PlacedSubmap> wanted = Within(outcome_.T_map_world.Inverse(), sensor_at_begin_);
  if (Stands(wanted)) return;
  outcome_.exchange = true;
  for (const PlacedSubmap& placed : wanted)
    outcome_.attached.push_back({placed.submap->id, placed.T_world_submap});
  outcome_.parts = AssembleFixed(wanted, map_, sensor_at_begin_);
}

// In the order of their ids.
std::vector<PlacedSubmap> LoopTrack::Within(const SE3& T_world_map,
                                            const Eigen::Vector3d& sensor) const {
  const std::vector<Submap>& submaps = closure_.submaps();
  std::vector<PlacedSubmap> within;
  for (std::size_t i = 0; i < submaps.size(); ++i) {
    const SE3 T = T_world_map * closure_.anchors()[i];
    const auto near = [&](const SubmapKeyframe& keyframe) {
      return (T * keyframe.T_submap_lidar.t - sensor).norm() <= options_.reach_m;
    };
    if (std::any_of(submaps[i].keyframes.begin(), submaps[i].keyframes.end(), near))
      within.push_back({&submaps[i], T});
  }
  return within;
}

// Whether the map has all of them where they are wanted.
bool LoopTrack::Stands(const std::vector<PlacedSubmap>& wanted) const {
  return std::all_of(wanted.begin(), wanted.end(), [&](const PlacedSubmap& placed) {
    SE3 stands = placed.submap->T_world_submap;  // as it was mapped
    if (!attached_.empty() && placed.submap->id <= attached_.back().id) {
      const auto found = std::find_if(attached_.begin(), attached_.end(),
                                      [&](const Attached& a) { return a.id == placed.submap->id; });
      if (found == attached_.end()) return false;
      stands = found->T_world_submap;
    }
    return AreClose(placed.T_world_submap, stands, kMovedM, kMovedRad);
  });
}

std::vector<VoxelMap::FixedPart> LoopTrack::TakeIn() {
  under_way_ = false;
  T_map_world_ = outcome_.T_map_world;
  if (outcome_.correction) ++corrections_;
  correction_ = std::move(outcome_.correction);
  if (!outcome_.exchange) return {};
  attached_ = std::move(outcome_.attached);
  std::vector<VoxelMap::FixedPart> parts = std::move(outcome_.parts);
  // Those since, which the closure has not seen.
  std::vector<PlacedSubmap> since;
  for (const Submap& submap : complete_) since.push_back({&submap, submap.T_world_submap});
  const Submap current = builder_.Current();
  if (!current.keyframes.empty()) since.push_back({&current, current.T_world_submap});
  for (VoxelMap::FixedPart& part : AssembleFixed(since, map_, sensor_))
    parts.push_back(std::move(part));
  return parts;
}

void LoopTrack::Finish() {
  // The map stays as it is: what it holds is for Resume() to exchange.
  const std::vector<Attached> in_map = attached_;
  TakeInAll();
  attached_ = in_map;
}

void LoopTrack::TakeInAll() {
  Advance();
  if (under_way_) {
    background_.Wait();
    TakeIn();
  }
  if (auto last = builder_.Finish()) Complete(std::move(*last));
  if (complete_.empty()) return;
  Begin();
  background_.Wait();
  TakeIn();
}

std::optional<std::vector<VoxelMap::FixedPart>> LoopTrack::Resume(const Eigen::Vector3d& sensor) {
  sensor_ = sensor_at_begin_ = sensor;
  if (!closure_.corrected()) return std::nullopt;
  Settle();
  const bool exchange = outcome_.exchange;
  std::vector<VoxelMap::FixedPart> parts = TakeIn();
  return exchange ? std::make_optional(std::move(parts)) : std::nullopt;
}

SE3 LoopTrack::Corrected(StampNs stamp_ns, const SE3& T_world_lidar) const {
  return correction_ ? correction_->Corrected(stamp_ns, T_world_lidar) : T_world_lidar;
}

const LoopClosure& LoopTrack::closure() const {
  background_.Wait();
  return closure_;
}

void LoopTrack::AddStoredPlaces(std::vector<StoredBytes>* places) const {
  const auto add = [&](const std::vector<Submap>& submaps) {
    for (const Submap& submap : submaps) {
      if (submap.store != nullptr) places->push_back(submap.stored);
    }
  };
  add(closure().submaps());
  add(complete_);
}

void LoopTrack::Archive(StateArchive& a) {
  background_.Wait();
  bool corrected = correction_.has_value();
  a(&builder_, &closure_, &sensor_, &sensor_at_begin_, &last_ns_, &keyframes_since_begin_,
    &T_map_world_, &corrections_, &attached_, &under_way_, &corrected);
  if (a.reading()) correction_ = corrected ? std::make_optional<AnchorCorrection>() : std::nullopt;
  if (corrected) a(&*correction_);
  if (a.reading() && under_way_) background_.Start([this] { Settle(); });
}

}  // namespace lamina
