// Clouds as COPC (Cloud Optimized Point Cloud 1.0): LAZ whose chunks are the nodes of an octree,
// with a table that says where each is, so that a viewer reads of a large cloud only what it shows,
// also over the network. Points are as in LAS (io/las/las_points.h), of format 6.
//
//     header | info | coordinate system, LAZ | chunks | their table | hierarchy
//
// Points come in any order. They are kept beside the file until all are there, 30 bytes each, and
// are sorted there: memory is bounded (some 150 MB), whatever their number.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "io/file/file_writer.h"
#include "io/file/spool_file.h"
#include "io/las/copc_nodes.h"
#include "io/las/las_points.h"
#include "io/las/laz_points.h"

namespace lamina {

class CopcFile {
 public:
  // Throws OutputError.
  explicit CopcFile(const std::string& path);

  // Throws OutputError, also for points that LasPoints refuses.
  void Append(const std::vector<CloudPoint>& points);
  // Sorts and packs all of them. Throws OutputError.
  void Commit();
  std::size_t count() const { return static_cast<std::size_t>(points_.count()); }

 private:
  struct Entry {
    CopcKey key;
    std::uint64_t place = 0;
    std::int32_t bytes = 0, points = 0;
  };

  int CubeBits() const;
  void Write(std::string_view bytes);
  void WriteNode(const CopcKey& key, std::string_view records);
  void WriteHierarchy();
  std::string Head() const;
  std::string Info() const;

  LasPoints points_;
  const LazLayout laz_;
  FileWriter writer_;
  SpoolFile spool_;
  std::uint64_t written_ = 0;  // bytes
  std::vector<LazChunk> chunks_;
  std::vector<Entry> entries_;
  // Of what stands behind the points.
  std::uint64_t extended_at_ = 0, root_page_at_ = 0, root_page_bytes_ = 0;
};

}  // namespace lamina
