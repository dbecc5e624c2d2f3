// Clouds as LAS 1.4, for GIS and CAD, and packed as LAZ (io/las/laz_points.h): points in the order
// in which they come, of point format 6 (io/las/las_points.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "io/file/file_writer.h"
#include "io/las/las_points.h"
#include "io/las/laz_points.h"

namespace lamina {

// Streams: header and bounds are written again at the end.
class LasFile {
 public:
  // Throws OutputError.
  LasFile(const std::string& path, bool packed);

  // Throws OutputError, also for points that LasPoints refuses.
  void Append(const std::vector<CloudPoint>& points);
  void Commit();
  std::size_t count() const { return static_cast<std::size_t>(points_.count()); }

 private:
  void WriteChunk(std::string_view records);
  std::string Header() const;

  LasPoints points_;
  const bool packed_;
  const LazLayout laz_;
  const std::string variable_records_;
  FileWriter writer_;
  std::string records_;  // that are not written yet
  std::vector<LazChunk> chunks_;
};

}  // namespace lamina
