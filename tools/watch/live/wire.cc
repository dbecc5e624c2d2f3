#include "tools/watch/live/wire.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

namespace lamina {
namespace {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the wire wants little-endian");

template <typename T>
void Put(std::string* bytes, T value) {
  bytes->append(reinterpret_cast<const char*>(&value), sizeof(T));
}

template <typename Vector>
void PutVector(std::string* bytes, const Vector& v) {
  for (int i = 0; i < v.size(); ++i) Put(bytes, v[i]);
}

// The number behind the hexadecimal digits; 0 for anything else.
std::uint64_t RunNumber(const std::string& run_id) {
  std::uint64_t number = 0;
  std::from_chars(run_id.data(), run_id.data() + run_id.size(), number, 16);
  return number;
}

// Rounded and held within the type's range; NaN is 0.
template <typename T>
T Saturated(double value) {
  if (std::isnan(value)) return T{0};
  return static_cast<T>(std::clamp(std::round(value),
                                   static_cast<double>(std::numeric_limits<T>::lowest()),
                                   static_cast<double>(std::numeric_limits<T>::max())));
}

void PutSurfel(std::string* bytes, const Surfel& s, const Eigen::Vector3d& corner) {
  PutVector(bytes, Eigen::Vector3f((s.centre - corner).cast<float>()));
  for (int i = 0; i < 3; ++i) {
    Put(bytes, Saturated<std::int8_t>(127.0 * static_cast<double>(s.normal[i])));
  }
  Put(bytes, std::int8_t{0});
  // Rounding may leave an eigenvalue below zero.
  const Eigen::Vector3d l = s.eigenvalues.cast<double>().cwiseMax(0.0);
  Put(bytes, Saturated<std::uint16_t>(1e3 * 2.0 * std::sqrt(std::sqrt(l[0] * l[1]))));
  Put(bytes, Saturated<std::uint16_t>(1e4 * std::sqrt(l[2])));
  Put(bytes, Saturated<std::int32_t>(static_cast<double>(s.last_keyframe)));
}

}  // namespace

std::string EncodeTrajectory(const TrajectoryPage& page, const std::string& run_id) {
  std::string bytes = "LTR2";
  bytes.reserve(32 + 64 * page.poses.size());
  Put(&bytes, static_cast<std::uint32_t>(page.poses.size()));
  Put(&bytes, RunNumber(run_id));
  Put(&bytes, page.version);
  Put(&bytes, page.next_index.value_or(-1));
  for (const LivePose& pose : page.poses) {
    Put(&bytes, pose.index);
    Put(&bytes, pose.stamp_ns);
    PutVector(&bytes, pose.T_world_lidar.t);
    PutVector(&bytes, Eigen::Vector4f(pose.T_world_lidar.q.coeffs().cast<float>()));
    Put(&bytes, pose.piece);
  }
  return bytes;
}

std::string EncodeScan(const LiveScan* scan, const std::string& run_id) {
  static const LiveScan kNone{-1, Eigen::Vector3d::Zero(), {}, 0};
  const LiveScan& s = scan == nullptr ? kNone : *scan;
  std::string bytes = "LSC2";
  bytes.reserve(56 + 12 * s.points.size());
  Put(&bytes, static_cast<std::uint32_t>(s.points.size()));
  Put(&bytes, RunNumber(run_id));
  Put(&bytes, s.index);
  PutVector(&bytes, s.origin);
  Put(&bytes, s.piece);
  for (const Eigen::Vector3f& p : s.points) PutVector(&bytes, p);
  return bytes;
}

std::string EncodeMap(const MapPage& page, const std::string& run_id) {
  std::size_t surfels = 0;
  for (const MapCell& cell : page.cells) surfels += cell.surfels.size();
  std::string bytes = "LMP1";
  bytes.reserve(40 + 16 * page.cells.size() + 24 * surfels);
  Put(&bytes, static_cast<std::uint32_t>(page.cells.size()));
  Put(&bytes, RunNumber(run_id));
  Put(&bytes, page.version);
  Put(&bytes, page.cell_size_m);
  Put(&bytes, static_cast<std::uint32_t>(surfels));
  Put(&bytes, page.next);
  for (const MapCell& cell : page.cells) {
    const Eigen::Matrix<std::int32_t, 3, 1> place(cell.ix, cell.iy, cell.iz);
    PutVector(&bytes, place);
    Put(&bytes, static_cast<std::uint32_t>(cell.surfels.size()));
    const Eigen::Vector3d corner = page.cell_size_m * place.cast<double>();
    for (const Surfel& surfel : cell.surfels) PutSurfel(&bytes, surfel, corner);
  }
  return bytes;
}

}  // namespace lamina
