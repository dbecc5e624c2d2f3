#include "tools/results/keyframe_file.h"

#include <fmt/format.h>

#include <string_view>

#include "core/base/error.h"
#include "core/geometry/state_archive.h"

namespace lamina {
namespace {

constexpr SectionFileKind kKeyframeKind = {"LAMINAKF", 1, "a file of keyframes"};
constexpr std::string_view kKeyframe = "KEYF";

}  // namespace

KeyframeWriter::KeyframeWriter(const std::string& path) : writer_(path, kKeyframeKind) {}

void KeyframeWriter::Add(std::int64_t piece, const FinalKeyframe& keyframe) {
  const SE3 T_lidar_world = keyframe.T_world_lidar.Inverse();
  const Eigen::Matrix3d R = T_lidar_world.R();
  std::vector<PackedCluster> clusters;
  for (const PointCluster& cluster : keyframe.clusters) {
    clusters.push_back(
        PackedCluster::Of(cluster.Moved(R, T_lidar_world.t), Eigen::Vector3d::Zero()));
  }
  StateArchive archive;
  std::int64_t id = keyframe.id;
  std::uint64_t count = clusters.size();
  archive(&piece, &id, &count);
  archive.Bytes(clusters.data(), clusters.size() * sizeof(PackedCluster));
  writer_.Write(kKeyframe, archive.written());
}

KeyframeFile::KeyframeFile(const std::string& path) : path_(path) {
  SectionReader reader(path, kKeyframeKind);
  std::string tag, bytes;
  while (reader.Next(&tag, &bytes)) {
    StateArchive archive{std::string_view(bytes)};
    std::int64_t piece = 0, id = 0;
    std::uint64_t count = 0;
    archive(&piece, &id, &count);
    if (tag != kKeyframe || archive.unread() != count * sizeof(PackedCluster))
      throw InputError(fmt::format("{}: has a section that does not belong there", path));
    places_[{piece, id}] = {reader.at() + bytes.size() - archive.unread(), count};
  }
  file_.open(path, std::ios::binary);
}

std::vector<PackedCluster> KeyframeFile::Read(std::int64_t piece, std::int64_t id) {
  const Place& place = places_.at({piece, id});
  std::vector<PackedCluster> clusters(static_cast<std::size_t>(place.clusters));
  file_.seekg(static_cast<std::streamoff>(place.at));
  file_.read(reinterpret_cast<char*>(clusters.data()),
             static_cast<std::streamsize>(clusters.size() * sizeof(PackedCluster)));
  if (!file_) throw InputError(fmt::format("{}: cannot be read again", path_));
  return clusters;
}

}  // namespace lamina
