// keyframes.bin: the clusters of each keyframe of a run, for bundle adjustment of all of them
// (`lamina campaign --level keyframes`). Where they stand is in submaps.bin, by piece and number.
//
// A file of sections (io/file/section_file.h), one for each keyframe:
//
//     "KEYF"   i64 piece, i64 number in it, u64 clusters, 40 bytes each: LiDAR frame, about its
//              origin (core/geometry/packed_cluster.h), with their weights in the map
#pragma once

#include <cstdint>
#include <fstream>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "backend/submaps/final_keyframe.h"
#include "core/geometry/packed_cluster.h"
#include "io/file/section_file.h"

namespace lamina {

inline constexpr const char* kKeyframeFileName = "keyframes.bin";

// Throws OutputError. Without Commit() nothing is left on disk.
class KeyframeWriter {
 public:
  explicit KeyframeWriter(const std::string& path);
  void Add(std::int64_t piece, const FinalKeyframe& keyframe);
  void Commit() { writer_.Commit(); }

 private:
  SectionWriter writer_;
};

// Not thread-safe. Throws InputError, naming the file, if it is damaged.
class KeyframeFile {
 public:
  // Reads all of it once, which makes sure that it is whole; keeps where each keyframe is.
  explicit KeyframeFile(const std::string& path);

  bool Has(std::int64_t piece, std::int64_t id) const { return places_.count({piece, id}) > 0; }
  std::vector<PackedCluster> Read(std::int64_t piece, std::int64_t id);

 private:
  struct Place {
    std::uint64_t at = 0, clusters = 0;
  };
  std::string path_;
  std::map<std::pair<std::int64_t, std::int64_t>, Place> places_;
  std::ifstream file_;
};

}  // namespace lamina
