#include "backend/submaps/submap.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lamina {

void SubmapOptions::Visit(OptionVisitor& v) {
  v.Number("length_m", &length_m, 0.1, 10000.0);
  v.Integer("max_keyframes", &max_keyframes, 2, 100000);
}

namespace {

Eigen::Vector3d CentreOf(const std::int16_t (&index)[3], double leaf_size_m) {
  return leaf_size_m * (Eigen::Vector3d(index[0], index[1], index[2]).array() + 0.5).matrix();
}

}  // namespace

PointCluster Submap::Cluster(const SubmapLeaf& leaf) const {
  return leaf.cluster.Unpacked(CentreOf(leaf.index, leaf_size_m));
}

SubmapLeaves Submap::Leaves() const {
  if (store == nullptr || !leaves.empty()) return SubmapLeaves(leaves);
  std::vector<SubmapLeaf> read(LeafCount());
  if (!store->Read(stored, reinterpret_cast<char*>(read.data()))) read.clear();
  return SubmapLeaves(std::move(read));
}

std::size_t Submap::LeafCount() const {
  return store == nullptr ? leaves.size() : stored.size / sizeof(SubmapLeaf);
}

void Submap::StoreIn(ByteStore* bytes) {
  const auto place = bytes->Append(
      {reinterpret_cast<const char*>(leaves.data()), leaves.size() * sizeof(SubmapLeaf)});
  if (!place) return;
  store = bytes;
  stored = *place;
}

void Submap::Release() {
  if (store != nullptr) leaves = {};
}

void Submap::Archive(StateArchive& a) {
  if (store == nullptr || a.reading()) {
    a(&id, &leaf_size_m, &T_world_submap, &keyframes, &leaves, &way_m);
    return;
  }
  const SubmapLeaves read = Leaves();
  std::vector<SubmapLeaf> all(read.begin(), read.end());
  a(&id, &leaf_size_m, &T_world_submap, &keyframes, &all, &way_m);
}

void Submap::ArchiveBeside(const ByteStore* bytes, StateArchive& a) {
  bool apart = store != nullptr;
  a(&apart);
  if (!apart) {
    Archive(a);
    return;
  }
  if (bytes == nullptr) throw InputError("a submap has its leaves in a file that is not there");
  a(&id, &leaf_size_m, &T_world_submap, &keyframes, &way_m, &stored.at, &stored.size,
    &stored.checksum);
  store = bytes;
}

SubmapBuilder::SubmapBuilder(const SubmapOptions& options, double leaf_size_m)
    : options_(options), leaf_size_m_(leaf_size_m) {
  CheckOptions(options, "loops.submap");
}

std::optional<Submap> SubmapBuilder::Add(const FinalKeyframe& keyframe) {
  std::optional<Submap> complete;
  if (!submap_.keyframes.empty()) {
    submap_.way_m += (keyframe.T_world_lidar.t - T_world_last_.t).norm();
    if (submap_.way_m >= options_.length_m ||
        static_cast<int>(submap_.keyframes.size()) >= options_.max_keyframes) {
      complete = Complete();
    }
  }
  if (submap_.keyframes.empty()) submap_.T_world_submap = keyframe.T_world_lidar;
  T_world_last_ = keyframe.T_world_lidar;
  AddClusters(keyframe);
  return complete;
}

std::optional<Submap> SubmapBuilder::Finish() {
  if (submap_.keyframes.empty()) return std::nullopt;
  return Complete();
}

std::int32_t SubmapBuilder::CellAt(const Eigen::Vector3d& p) {
  const Eigen::Array3d place = (p / leaf_size_m_).array().floor();
  // False for NaN, too.
  if (!(place.abs() < static_cast<double>(std::numeric_limits<std::int16_t>::max())).all())
    return VoxelIndex::kNone;
  Cell cell;
  for (int axis = 0; axis < 3; ++axis) cell.index[axis] = static_cast<std::int16_t>(place[axis]);
  const auto next = static_cast<std::int32_t>(cells_.size());
  const std::int32_t at =
      index_.FindOrInsert(PackVoxelKey(cell.index[0], cell.index[1], cell.index[2]), next);
  if (at == next) cells_.push_back(cell);
  return at;
}

void SubmapBuilder::AddClusters(const FinalKeyframe& keyframe) {
  // Cells lie anywhere in memory: so many are on their way to the cache.
  constexpr std::size_t kAhead = 8;
  const SE3 T_submap_world = submap_.T_world_submap.Inverse();
  submap_.keyframes.push_back(
      {keyframe.id, keyframe.stamp_ns, T_submap_world * keyframe.T_world_lidar});
  const Eigen::Matrix3d R = T_submap_world.R();
  const std::vector<PointCluster>& clusters = keyframe.clusters;
  std::vector<std::int32_t> cells(clusters.size(), VoxelIndex::kNone);
  for (std::size_t i = 0; i < clusters.size(); ++i) {
    if (!clusters[i].Empty()) cells[i] = CellAt(R * clusters[i].mean + T_submap_world.t);
  }
  for (std::size_t i = 0; i < clusters.size(); ++i) {
    if (i + kAhead < clusters.size() && cells[i + kAhead] != VoxelIndex::kNone)
      Prefetch(cells_[static_cast<std::size_t>(cells[i + kAhead])]);
    if (cells[i] == VoxelIndex::kNone) continue;
    Cell& cell = cells_[static_cast<std::size_t>(cells[i])];
    if (cell.last != keyframe.id && cell.keyframes < std::numeric_limits<std::uint16_t>::max())
      ++cell.keyframes;
    cell.last = keyframe.id;
    cell.in_world += clusters[i];
  }
}

std::vector<SubmapLeaf> SubmapBuilder::Leaves() const {
  const SE3 T_submap_world = submap_.T_world_submap.Inverse();
  const Eigen::Matrix3d R = T_submap_world.R();
  std::vector<SubmapLeaf> leaves;
  leaves.reserve(cells_.size());
  for (const Cell& cell : cells_) {
    SubmapLeaf leaf;
    leaf.keyframes = cell.keyframes;
    std::copy(cell.index, cell.index + 3, leaf.index);
    leaf.cluster = PackedCluster::Of(cell.in_world.Moved(R, T_submap_world.t),
                                     CentreOf(cell.index, leaf_size_m_));
    leaves.push_back(leaf);
  }
  std::sort(leaves.begin(), leaves.end(), [](const SubmapLeaf& a, const SubmapLeaf& b) {
    return std::lexicographical_compare(a.index, a.index + 3, b.index, b.index + 3);
  });
  return leaves;
}

Submap SubmapBuilder::Current() const {
  Submap submap = submap_;
  submap.leaf_size_m = leaf_size_m_;
  submap.leaves = Leaves();
  return submap;
}

Submap SubmapBuilder::Complete() {
  Submap complete = Current();
  submap_ = Submap();
  submap_.id = complete.id + 1;
  cells_.clear();
  index_ = VoxelIndex();
  return complete;
}

void SubmapBuilder::Archive(StateArchive& a) {
  a(&submap_, &T_world_last_);
  cells_.resize(a.Size(cells_.size(), sizeof(PointCluster)));
  if (a.reading()) index_ = VoxelIndex();
  for (std::size_t i = 0; i < cells_.size(); ++i) {
    Cell& cell = cells_[i];
    for (std::int16_t& index : cell.index) a(&index);
    a(&cell.keyframes, &cell.last, &cell.in_world);
    if (a.reading())
      index_.FindOrInsert(PackVoxelKey(cell.index[0], cell.index[1], cell.index[2]),
                          static_cast<std::int32_t>(i));
  }
}

}  // namespace lamina
