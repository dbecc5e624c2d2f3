#include "tools/merge/merged_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <utility>

#include "backend/loops/map_refinement.h"
#include "core/base/error.h"

namespace lamina {
namespace {

// Of association, as a factor, where all pairs are compared.
constexpr int kMoreRounds = 4;

template <typename Visit>
void ForEachSubmap(const std::vector<Drive>& drives, const Visit& visit) {
  for (const Drive& drive : drives) {
    for (const SubmapFrame& frame : drive.frames) {
      for (const Submap& submap : frame.submaps) visit(drive, submap);
    }
  }
}

void CheckLeaves(const std::vector<Drive>& drives) {
  const Submap* first = nullptr;
  ForEachSubmap(drives, [&](const Drive& drive, const Submap& submap) {
    if (first == nullptr) first = &submap;
    if (submap.leaf_size_m == first->leaf_size_m) return;
    throw InputError(fmt::format(
        "{}: its voxels are of {} m, those of {} of {} m: drives to be merged need the same "
        "map.root_size_m and map.depth. Map one of them again with those of the other, which are "
        "in its config.yaml (lamina run --config)",
        drive.folder, submap.leaf_size_m, drives.front().folder, first->leaf_size_m));
  });
}

bool AreTheSame(const Submap& a, const Submap& b) {
  const auto same = [](const SubmapKeyframe& x, const SubmapKeyframe& y) {
    return x.id == y.id && x.stamp_ns == y.stamp_ns && x.T_submap_lidar.t == y.T_submap_lidar.t &&
           x.T_submap_lidar.q.coeffs() == y.T_submap_lidar.q.coeffs();
  };
  return a.LeafCount() == b.LeafCount() && a.keyframes.size() > 1 &&
         std::equal(a.keyframes.begin(), a.keyframes.end(), b.keyframes.begin(), b.keyframes.end(),
                    same);
}

// A drive that is there twice would be drawn twice, and agree with itself to the bit.
void RefuseRepeated(const std::vector<Drive>& drives) {
  std::multimap<StampNs, std::pair<const Drive*, const Submap*>> by_stamp;
  ForEachSubmap(drives, [&](const Drive& drive, const Submap& submap) {
    if (submap.keyframes.empty()) return;
    const StampNs stamp_ns = submap.keyframes.front().stamp_ns;
    const auto [begin, end] = by_stamp.equal_range(stamp_ns);
    for (auto other = begin; other != end; ++other) {
      const auto& [of, known] = other->second;
      if (of == &drive || !AreTheSame(submap, *known)) continue;
      throw InputError(fmt::format("{}: has a part of the map of {}: the same drive is there twice",
                                   drive.folder, of->folder));
    }
    by_stamp.emplace(stamp_ns, std::make_pair(&drive, &submap));
  });
}

}  // namespace

MergedMap::MergedMap(const std::vector<Drive>& drives, const LaminaConfig& config, Effort effort,
                     const Work& work, const WorkSharing& sharing)
    : drives_(drives) {
  CheckLeaves(drives);
  RefuseRepeated(drives);
  std::vector<MapPiece> pieces;
  for (std::size_t d = 0; d < drives.size(); ++d) {
    for (std::size_t f = 0; f < drives[d].frames.size(); ++f) {
      parts_.emplace_back(d, f);
      pieces.push_back({&drives[d].frames[f].submaps, drives[d].frames[f].graph});
    }
  }
  joined_ = JoinPieces(pieces, config.loops, config.map, config.frontend.matcher, sharing);
  AddOrigins();
  NumberFrames();
  std::vector<const Submap*> submaps;
  for (const Origin& origin : origins_) submaps.push_back(origin.submap);
  SubmapBundleOptions bundle = config.loops.bundle;
  if (effort == Effort::kAllPairs) {
    Refine(submaps, config, work);
    bundle.rounds *= kMoreRounds;
  }
  bundle_ = AdjustSubmaps(submaps, joined_.graph, bundle, config.map, work.bundle);
  joined_.graph.poses = bundle_.anchors;
  CorrectDrives();
}

void MergedMap::Refine(const std::vector<const Submap*>& submaps, const LaminaConfig& config,
                       const Work& work) {
  RefinedGraph refined = RefineGraph(submaps, joined_.graph, config.loops, config.map,
                                     config.frontend.matcher, work.on_pairs, work.bundle.journal);
  joined_.graph = std::move(refined.graph);
  joined_.loops.insert(joined_.loops.end(), refined.loops.begin(), refined.loops.end());
}

void MergedMap::AddOrigins() {
  for (const auto& [d, f] : parts_) {
    const SubmapFrame& frame = drives_[d].frames[f];
    for (std::size_t i = 0; i < frame.submaps.size(); ++i)
      origins_.push_back({d, frame.pieces[i], &frame.submaps[i]});
  }
}

void MergedMap::NumberFrames() {
  std::map<std::size_t, std::size_t> number;
  frame_of_.resize(origins_.size());
  for (std::size_t p = 0; p < parts_.size(); ++p) {
    const auto [at, fresh] = number.try_emplace(joined_.part[p], members_.size());
    if (fresh) members_.emplace_back();
    const auto& [d, f] = parts_[p];
    const std::size_t first = joined_.first_submap[p];
    for (std::size_t i = first; i < first + drives_[d].frames[f].submaps.size(); ++i) {
      frame_of_[i] = at->second;
      members_[at->second].push_back(i);
      frame_of_piece_[{d, origins_[i].piece}] = at->second;
    }
  }
  for (const std::vector<std::size_t>& members : members_) {
    for (const std::size_t i : members) {
      const auto next = static_cast<std::int64_t>(numbers_.size());
      numbers_.try_emplace({origins_[i].drive, origins_[i].piece}, next);
    }
  }
}

namespace {

// Of a piece whose first submap has this position in the frame.
std::vector<TrimmedSubmap> TrimmedOf(const SubmapFrame& frame, std::int64_t piece,
                                     std::size_t first) {
  const auto found = frame.trimmed.find(piece);
  if (found == frame.trimmed.end()) return {};
  return Shifted(found->second, -static_cast<std::ptrdiff_t>(first));
}

}  // namespace

FrameTrimmings MergedMap::TrimmedOfFrame(std::size_t frame) const {
  FrameTrimmings all;
  for (std::size_t p = 0; p < parts_.size(); ++p) {
    const auto& [d, f] = parts_[p];
    const std::size_t first = joined_.first_submap[p];
    if (drives_[d].frames[f].submaps.empty() || frame_of_[first] != frame) continue;
    const std::vector<std::size_t>& members = members_[frame];
    const auto position = std::lower_bound(members.begin(), members.end(), first) - members.begin();
    for (const auto& [piece, trimmed] : drives_[d].frames[f].trimmed)
      all[PieceNumber(d, piece)] = Shifted(trimmed, position);
  }
  return all;
}

void MergedMap::CorrectDrives() {
  for (std::size_t p = 0; p < parts_.size(); ++p) {
    const auto& [d, f] = parts_[p];
    const SubmapFrame& frame = drives_[d].frames[f];
    for (std::size_t begin = 0, end = 0; begin < frame.submaps.size(); begin = end) {
      std::vector<const Submap*> submaps;
      std::vector<SE3> from, to;
      for (; end < frame.submaps.size() && frame.pieces[end] == frame.pieces[begin]; ++end) {
        submaps.push_back(&frame.submaps[end]);
        from.push_back(frame.graph.poses[end]);
        to.push_back(joined_.graph.poses[joined_.first_submap[p] + end]);
      }
      corrections_.try_emplace({d, frame.pieces[begin]}, submaps, from, to,
                               TrimmedOf(frame, frame.pieces[begin], begin));
    }
  }
}

std::vector<MergedMap::Posed> MergedMap::PosesOf(std::size_t drive) const {
  std::vector<Posed> posed;
  for (const DrivePose& pose : drives_[drive].poses) {
    const auto correction = corrections_.find({drive, pose.piece});
    if (correction == corrections_.end()) continue;
    SE3 T = correction->second.Corrected(pose.pose.stamp_ns, pose.pose.T_world_lidar);
    const auto further = keyframe_corrections_.find({drive, pose.piece});
    if (further != keyframe_corrections_.end())
      T = further->second.Corrected(pose.pose.stamp_ns, T);
    posed.push_back(
        {frame_of_piece_.at({drive, pose.piece}), PieceNumber(drive, pose.piece), &pose, T});
  }
  return posed;
}

std::vector<std::vector<SE3>> MergedMap::KeyframePoses() const {
  std::vector<std::vector<SE3>> poses(origins_.size());
  for (std::size_t p = 0; p < parts_.size(); ++p) {
    const auto& [d, f] = parts_[p];
    const SubmapFrame& frame = drives_[d].frames[f];
    for (std::size_t begin = 0, end = 0; begin < frame.submaps.size(); begin = end) {
      std::vector<const Submap*> submaps;
      std::vector<SE3> odometry, anchors;
      for (; end < frame.submaps.size() && frame.pieces[end] == frame.pieces[begin]; ++end) {
        submaps.push_back(&frame.submaps[end]);
        odometry.push_back(frame.submaps[end].T_world_submap);
        anchors.push_back(frame.graph.poses[end]);
      }
      const AnchorCorrection of_drive(submaps, odometry, anchors,
                                      TrimmedOf(frame, frame.pieces[begin], begin));
      const AnchorCorrection& of_map = corrections_.at({d, frame.pieces[begin]});
      for (std::size_t i = begin; i < end; ++i) {
        for (const SubmapKeyframe& keyframe : frame.submaps[i].keyframes) {
          const SE3 T = odometry[i - begin] * keyframe.T_submap_lidar;
          poses[joined_.first_submap[p] + i].push_back(
              of_map.Corrected(keyframe.stamp_ns, of_drive.Corrected(keyframe.stamp_ns, T)));
        }
      }
    }
  }
  return poses;
}

void MergedMap::MoveKeyframes(const std::vector<std::vector<SE3>>& from,
                              const std::vector<std::vector<SE3>>& to, const ReadClusters& read) {
  struct Moves {
    std::vector<StampNs> stamps;
    std::vector<SE3> from, to;
  };
  std::map<std::pair<std::size_t, std::int64_t>, Moves> moves;
  moved_.resize(origins_.size());
  for (std::size_t i = 0; i < origins_.size(); ++i) {
    const Submap& old = *origins_[i].submap;
    SubmapOptions whole;
    whole.length_m = 1e4;
    whole.max_keyframes = static_cast<int>(old.keyframes.size()) + 1;
    SubmapBuilder builder(whole, old.leaf_size_m);
    Moves& of_piece = moves[{origins_[i].drive, origins_[i].piece}];
    for (std::size_t k = 0; k < old.keyframes.size(); ++k) {
      const SubmapKeyframe& keyframe = old.keyframes[k];
      FinalKeyframe final{keyframe.id, keyframe.stamp_ns, to[i][k], {}};
      for (const PackedCluster& cluster : read(i, k))
        final.clusters.push_back(cluster.Unpacked(Eigen::Vector3d::Zero()).Moved(to[i][k]));
      builder.Add(final);
      of_piece.stamps.push_back(keyframe.stamp_ns);
      of_piece.from.push_back(from[i][k]);
      of_piece.to.push_back(to[i][k]);
    }
    Submap& made = moved_[i] = *builder.Finish();
    joined_.graph.poses[i] = made.T_world_submap;
    made.id = old.id;
    made.way_m = old.way_m;
    made.T_world_submap = old.T_world_submap;
  }
  for (std::size_t i = 0; i < origins_.size(); ++i) origins_[i].submap = &moved_[i];
  for (auto& [piece, move] : moves)
    keyframe_corrections_.try_emplace(piece, std::move(move.stamps), move.from, move.to);
}

void MergedMap::AddTo(VoxelMap* map) const {
  for (std::size_t frame = 0; frame < members_.size(); ++frame) {
    const auto piece = static_cast<std::int64_t>(frame);
    if (map->HasPiece(piece)) {
      map->SelectPiece(piece);
    } else {
      map->BeginPiece(piece);
    }
    for (const std::size_t i : members_[frame])
      AddToMap(*origins_[i].submap, joined_.graph.poses[i], map);
  }
}

}  // namespace lamina
