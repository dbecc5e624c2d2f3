#include "tools/python/arrays.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/base/error.h"

namespace lamina::python {
namespace {

namespace py = pybind11;

void WritePose(const SE3& T, double* out) {
  Eigen::Map<Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> matrix(out);
  matrix.setIdentity();
  matrix.topLeftCorner<3, 3>() = T.R();
  matrix.topRightCorner<3, 1>() = T.t;
}

std::string ShapeOf(const py::array& array) {
  std::string text = "(";
  for (py::ssize_t i = 0; i < array.ndim(); ++i) {
    text += (i > 0 ? ", " : "") + std::to_string(array.shape(i));
  }
  return text + ")";
}

template <typename T, typename From>
py::array_t<T> ToArray(const std::vector<From>& values) {
  py::array_t<T> array(static_cast<py::ssize_t>(values.size()));
  std::copy(values.begin(), values.end(), array.mutable_data());
  return array;
}

}  // namespace

Scan ScanFromArrays(const Points& points, std::int64_t stamp_ns,
                    const std::optional<Times>& times_s) {
  if (points.ndim() != 2 || (points.shape(1) != 3 && points.shape(1) != 4)) {
    throw InputError("points must have the shape (N, 3) or (N, 4), not " + ShapeOf(points));
  }
  const auto count = static_cast<std::size_t>(points.shape(0));
  Scan scan;
  scan.stamp_ns = stamp_ns;
  scan.points.resize(count);
  if (points.shape(1) == 4) {
    if (count > 0)
      std::memcpy(static_cast<void*>(scan.points.data()), points.data(), count * sizeof(ScanPoint));
  } else {
    const float* from = points.data();
    for (ScanPoint& p : scan.points) {
      p = {from[0], from[1], from[2], 0.0F};
      from += 3;
    }
  }
  if (!times_s) return scan;
  if (times_s->ndim() != 1 || times_s->shape(0) != points.shape(0)) {
    throw InputError("times must have the shape (N,), one for each of the " +
                     std::to_string(count) + " points, not " + ShapeOf(*times_s));
  }
  scan.time_s.assign(times_s->data(), times_s->data() + count);
  const bool finite =
      std::all_of(scan.time_s.begin(), scan.time_s.end(), [](float t) { return std::isfinite(t); });
  if (!finite) throw InputError("times must be finite");
  return scan;
}

py::array_t<float> PointsOf(const Scan& scan) {
  py::array_t<float> array({static_cast<py::ssize_t>(scan.points.size()), py::ssize_t{4}});
  if (!scan.points.empty()) {
    std::memcpy(array.mutable_data(), scan.points.data(), scan.points.size() * sizeof(ScanPoint));
  }
  return array;
}

py::object TimesOf(const Scan& scan) {
  if (scan.time_s.empty()) return py::none();
  return ToArray<float>(scan.time_s);
}

py::array_t<double> PoseArray(const SE3& T) {
  py::array_t<double> array({py::ssize_t{4}, py::ssize_t{4}});
  WritePose(T, array.mutable_data());
  return array;
}

Trajectory TrajectoryFromPoses(const Poses& poses, const std::string& name) {
  if (poses.ndim() != 3 || poses.shape(1) != 4 || poses.shape(2) != 4) {
    throw InputError(name + " must have the shape (N, 4, 4), not " + ShapeOf(poses));
  }
  constexpr double kTolerance = 1e-3;
  constexpr StampNs kSecondNs = 1'000'000'000;
  Trajectory trajectory;
  for (py::ssize_t i = 0; i < poses.shape(0); ++i) {
    const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> T(poses.data(i, 0, 0));
    const Eigen::Matrix3d R = T.topLeftCorner<3, 3>();
    const double off = (R * R.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
    if (!T.allFinite() || !(off <= kTolerance) || R.determinant() < 0.0) {
      throw InputError(name + ": matrix " + std::to_string(i) + " is no pose");
    }
    trajectory.push_back({kSecondNs * i, SE3(R, T.topRightCorner<3, 1>())});
  }
  return trajectory;
}

void PoseList::Add(const StampedPose& pose, bool was_skipped, std::int64_t piece) {
  stamps_ns.push_back(pose.stamp_ns);
  poses.push_back(pose.T_world_lidar);
  skipped.push_back(was_skipped);
  pieces.push_back(piece);
}

py::array_t<std::int64_t> PoseList::StampArray() const { return ToArray<std::int64_t>(stamps_ns); }
py::array_t<std::int64_t> PoseList::PieceArray() const { return ToArray<std::int64_t>(pieces); }
py::array_t<bool> PoseList::SkippedArray() const { return ToArray<bool>(skipped); }

py::array_t<double> PoseList::Array() const {
  py::array_t<double> array(
      {static_cast<py::ssize_t>(poses.size()), py::ssize_t{4}, py::ssize_t{4}});
  double* out = array.mutable_data();
  for (const SE3& T : poses) {
    WritePose(T, out);
    out += 16;
  }
  return array;
}

}  // namespace lamina::python
