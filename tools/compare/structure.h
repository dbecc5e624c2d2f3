// How far a map is from the true surfaces (paper IV-B2, figures 2 and 3).
//
// The map is that of a method's poses, aligned to the truth as a whole (rotation: the chordal mean
// of the differences; then the mean translation), its points thinned to one for each voxel. A
// point's error is its distance to the nearest point of the reference cloud, which should therefore
// be dense.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "core/geometry/se3.h"
#include "core/map/voxel_key.h"
#include "tools/compare/results/rows.h"

namespace lamina {

// Colour bar and distribution end here.
inline constexpr double kStructuralRangeM = 0.05;
// Farther than this is no nearer looked at: the map's point has nothing beside it.
inline constexpr double kStructuralBoundM = 0.3;

// A cloud that is asked for nearest points. Thread-safe once constructed.
class ReferenceCloud {
 public:
  // Reads any point file; world frame of the truth. Throws InputError.
  explicit ReferenceCloud(const std::string& path);
  explicit ReferenceCloud(const std::vector<Eigen::Vector3f>& points);
  // Distance to the nearest point, or the bound where nothing is nearer.
  double Distance(const Eigen::Vector3f& p) const;

 private:
  void Build(const std::vector<Eigen::Vector3f>& points);
  VoxelIndex cells_;
  std::vector<std::uint32_t> starts_;  // of each cell in points_
  std::vector<Eigen::Vector3f> points_;
};

// T with T * poses ~ truth. Same length, at least one.
SE3 AlignPoses(const std::vector<SE3>& poses, const std::vector<SE3>& truth);

struct MapPoint {
  Eigen::Vector3f position;
  float error_m = 0.0F;
};

// `scans`: points of each scan, its own frame.
std::vector<MapPoint> MeasureStructure(const std::vector<std::vector<Eigen::Vector3f>>& scans,
                                       const std::vector<SE3>& poses, const std::vector<SE3>& truth,
                                       const ReferenceCloud& reference);
StructuralError Summarise(const std::vector<MapPoint>& map);

// x y z error (float), red green blue (uchar): blue at 0, through green and yellow, red at 5 cm and
// beyond. Binary PLY. Throws OutputError.
void WriteHeatMap(const std::string& path, const std::vector<MapPoint>& map);

// The same seen from above at a slant, with its colour bar; .png or .svg. Points hide what is
// behind them; those above `top_m`, ceilings, are left out. Throws OutputError.
void DrawHeatMap(const std::string& path, const std::string& title, double top_m,
                 const std::vector<MapPoint>& map);

}  // namespace lamina
