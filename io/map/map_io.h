// Maps and clouds on disk, as PLY (binary little-endian), PCD (binary), LAS, LAZ and COPC.
//
// PLY and PCD have coordinates as float, as every viewer expects: exact to 1 mm within 8 km of the
// world's origin. LAS, LAZ and COPC keep 0.1 mm anywhere (io/las/las_points.h).
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "core/geometry/scan.h"
#include "core/map/surfel.h"
#include "io/las/cloud_point.h"

namespace lamina {

// Surfels written one by one, in bounded memory; format by the ending of the path, .ply or .pcd:
// x y z nx ny nz (float), l1 l2 l3 (eigenvalues, float, m^2), thickness_m (float), count (uint),
// red green blue (uchar). The colour tells the thickness sqrt(l3): blue at 0, green at 25 mm, red
// at 50 mm and above, blended linearly between. PCD has the names that PCL gives to normals,
// normal_x normal_y normal_z, and `rgb` (uint32, 0x00RRGGBB) for the colour. Same surfels, same
// bytes. All members throw OutputError; OptionError for another ending.
class SurfelWriter {
 public:
  explicit SurfelWriter(const std::string& path);
  ~SurfelWriter();
  void Append(const Surfel& surfel);
  void Commit();  // Without it, nothing is left on disk.
  std::size_t size() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// The same in one call.
void WriteSurfels(const std::string& path, const SurfelMap& surfels);

// A cloud written piece by piece, in bounded memory: the count in the header is patched at the end.
// Format by the ending of the path: .ply or .pcd (x y z intensity, float); .las, .laz or .copc.laz
// (with stamps; the last is sorted by Commit(), see io/las/copc_file.h). Throws OutputError;
// OptionError for another ending.
class CloudWriter {
 public:
  explicit CloudWriter(const std::string& path);
  ~CloudWriter();
  void Append(const std::vector<CloudPoint>& points);
  // Points without stamps.
  void Append(const std::vector<ScanPoint>& points);
  void Commit();  // Without it, nothing is left on disk.
  std::size_t size() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lamina
