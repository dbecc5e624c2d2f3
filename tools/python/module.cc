// The Python module `lamina`: mapping, recordings and evaluation with NumPy arrays. What it offers
// is described, with types, in lamina.pyi, from where `help` has it.
#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "backend/loops/piece_loops.h"
#include "backend/mapping/mapping.h"
#include "backend/mapping/pipeline.h"
#include "config/config.h"
#include "core/base/error.h"
#include "io/map/trajectory_io.h"
#include "io/recording/scan_source.h"
#include "tools/metrics/trajectory_metrics.h"
#include "tools/python/arrays.h"
#include "tools/python/docs.h"

namespace lamina::python {
namespace {

namespace py = pybind11;

LaminaConfig ConfigOf(const std::string& config, const py::dict& options) {
  std::vector<std::string> pairs;
  for (const auto& [key, value] : options) {
    std::string text = py::str(value);
    if (py::isinstance<py::bool_>(value)) text = value.cast<bool>() ? "true" : "false";
    pairs.push_back(std::string(py::str(key)) + "=" + text);
  }
  return LoadConfig(config, pairs);
}

// A recording on disk.
class Recording {
 public:
  Recording(const std::string& path, const LaminaConfig& config)
      : source_(OpenScans(path, config.scans)) {}

  std::size_t size() const { return source_->size(); }
  const ScanSource& source() const { return *source_; }
  std::size_t PlaceOf(py::ssize_t i) const {
    const auto count = static_cast<py::ssize_t>(size());
    if (i < -count || i >= count) {
      throw py::index_error("the recording has " + std::to_string(count) + " scans");
    }
    return static_cast<std::size_t>(i < 0 ? i + count : i);
  }

 private:
  std::unique_ptr<ScanSource> source_;
};

// Mapping with the poses of all scans kept, which a notebook wants at its end.
class PyMapping {
 public:
  explicit PyMapping(const LaminaConfig& config)
      : options_(config.Mapping()), mapping_(options_, Callbacks()) {}

  MappedScan Add(const Points& points, std::optional<std::int64_t> stamp_ns,
                 const std::optional<Times>& times_s, const std::string& recording) {
    constexpr std::int64_t kPeriodNs = 100'000'000;
    const auto count = static_cast<std::int64_t>(mapping_.counts().scans);
    Scan scan = ScanFromArrays(points, stamp_ns.value_or(kPeriodNs * count), times_s);
    scan.stamp_made_up = !stamp_ns.has_value();
    const py::gil_scoped_release release;
    return mapping_.Add(scan, recording);
  }

  void AddRecording(const Recording& recording, std::size_t first,
                    std::optional<std::size_t> last) {
    const std::size_t end = std::min(last.value_or(recording.size()), recording.size());
    if (first > end) throw InputError("first must not be behind last");
    const py::gil_scoped_release release;
    MapScans(recording.source(), {first, first, end}, &mapping_);
  }

  void Finish() {
    const py::gil_scoped_release release;
    if (!finished_) mapping_.Finish();
    finished_ = true;
  }

  // In the frame of the map, as loops have corrected it by now, or in that of odometry.
  PoseList Poses(const std::string& frame) const {
    if (frame != "map" && frame != "odom") throw OptionError("frame must be map or odom");
    std::vector<FinalPose> all = final_;
    if (!finished_) mapping_.ShowOpenPoses([&](const FinalPose& pose) { all.push_back(pose); });
    PoseList poses;
    const PieceLoops* const loops = frame == "map" ? mapping_.loops() : nullptr;
    for (FinalPose& pose : all) {
      SE3& T = pose.pose.T_world_lidar;
      if (loops != nullptr) T = loops->Corrected(pose.piece, pose.pose.stamp_ns, T);
      poses.Add(pose.pose, pose.skipped, pose.piece);
    }
    return poses;
  }

  py::dict Surfels(std::optional<int> min_frames) const {
    const int frames = min_frames.value_or(options_.mapper.backend.min_surfel_frames);
    std::vector<Surfel> surfels;
    mapping_.map().ForEachSurface(frames, [&](const Surfel& s) { surfels.push_back(s); });
    const auto count = static_cast<py::ssize_t>(surfels.size());
    py::array_t<double> centre({count, py::ssize_t{3}});
    py::array_t<float> normal({count, py::ssize_t{3}}), eigenvalues({count, py::ssize_t{3}});
    py::array_t<std::uint32_t> points(count);
    py::array_t<std::int64_t> piece(count);
    for (py::ssize_t i = 0; i < count; ++i) {
      const Surfel& s = surfels[static_cast<std::size_t>(i)];
      for (py::ssize_t k = 0; k < 3; ++k) {
        centre.mutable_at(i, k) = s.centre(k);
        normal.mutable_at(i, k) = s.normal(k);
        eigenvalues.mutable_at(i, k) = s.eigenvalues(k);
      }
      points.mutable_at(i) = s.count;
      piece.mutable_at(i) = s.piece;
    }
    py::dict result;
    result["centre"] = centre;
    result["normal"] = normal;
    result["eigenvalues"] = eigenvalues;
    result["count"] = points;
    result["piece"] = piece;
    return result;
  }

  py::dict Counts() const {
    const MappingCounts& counts = mapping_.counts();
    py::dict result;
    result["scans"] = counts.scans;
    result["frames"] = counts.frames;
    result["keyframes"] = counts.keyframes;
    result["lost"] = counts.lost;
    result["degenerate"] = counts.degenerate;
    result["pieces"] = counts.pieces;
    result["solves"] = counts.solves;
    return result;
  }

 private:
  MappingCallbacks Callbacks() {
    MappingCallbacks callbacks;
    callbacks.on_final_pose = [this](const FinalPose& pose) { final_.push_back(pose); };
    return callbacks;
  }

  MappingOptions options_;
  std::vector<FinalPose> final_;
  bool finished_ = false;
  Mapping mapping_;
};

py::dict Evaluate(const Poses& estimate, const Poses& truth, const std::string& alignment) {
  const std::vector<std::string> names = {"se3", "first", "none"};
  const auto chosen = std::find(names.begin(), names.end(), alignment);
  if (chosen == names.end()) throw OptionError("alignment must be se3, first or none");
  const TrajectoryErrors errors = CompareTrajectories(
      TrajectoryFromPoses(estimate, "estimate"), TrajectoryFromPoses(truth, "truth"),
      static_cast<Alignment>(chosen - names.begin()));
  const auto segments = [](const std::vector<SegmentError>& list) {
    py::dict by_length;
    for (const SegmentError& s : list) {
      if (s.segments > 0) by_length[py::float_(s.length_m)] = s.translation_percent;
    }
    return by_length;
  };
  py::dict result;
  result["poses"] = errors.poses;
  result["length_m"] = errors.length_m;
  result["ape_rmse_m"] = errors.ape_rmse_m;
  result["ape_max_m"] = errors.ape_max_m;
  result["rpe_rmse_m"] = errors.rpe_rmse_m;
  result["rpe_rmse_deg"] = errors.rpe_rmse_deg;
  result["short_segments_percent"] = segments(errors.short_segments);
  result["kitti_segments_percent"] = segments(errors.kitti_segments);
  result["kitti_trel_percent"] = errors.kitti_trel_percent;
  return result;
}

PoseList ReadPoses(const std::filesystem::path& path) {
  PoseList poses;
  for (const StampedPose& pose : ReadTrajectory(path.string())) poses.Add(pose, false, 0);
  return poses;
}

void BindMapping(py::module_* m) {
  py::class_<MappedScan>(*m, "MappedScan", Doc("MappedScan"))
      .def_readonly("index", &MappedScan::index, Doc("MappedScan.index"))
      .def_readonly("stamp_ns", &MappedScan::stamp_ns, Doc("MappedScan.stamp_ns"))
      .def_readonly("recording", &MappedScan::recording, Doc("MappedScan.recording"))
      .def_property_readonly(
          "status", [](const MappedScan& s) { return StatusName(s); }, Doc("MappedScan.status"))
      .def_readonly("skipped", &MappedScan::skipped, Doc("MappedScan.skipped"))
      .def_readonly("detail", &MappedScan::detail, Doc("MappedScan.detail"))
      .def_property_readonly(
          "pose", [](const MappedScan& s) { return PoseArray(s.odometry.T_world_lidar); },
          Doc("MappedScan.pose"))
      .def_property_readonly(
          "pose_in_map",
          [](const MappedScan& s) { return PoseArray(s.T_map_world * s.odometry.T_world_lidar); },
          Doc("MappedScan.pose_in_map"))
      .def_property_readonly(
          "covariance",
          [](const MappedScan& s) { return Eigen::MatrixXd(s.odometry.match.covariance); },
          Doc("MappedScan.covariance"))
      .def_property_readonly(
          "inlier_share", [](const MappedScan& s) { return s.odometry.match.inlier_share; },
          Doc("MappedScan.inlier_share"))
      .def_property_readonly(
          "residual_m", [](const MappedScan& s) { return s.odometry.match.residual_rms_m; },
          Doc("MappedScan.residual_m"))
      .def_property_readonly(
          "unobservable_directions",
          [](const MappedScan& s) { return s.odometry.match.degenerate; },
          Doc("MappedScan.unobservable_directions"))
      .def_readonly("keyframe", &MappedScan::keyframe, Doc("MappedScan.keyframe"))
      .def_readonly("piece", &MappedScan::piece, Doc("MappedScan.piece"))
      .def_readonly("points", &MappedScan::points, Doc("MappedScan.points"))
      .def_readonly("clusters", &MappedScan::clusters, Doc("MappedScan.clusters"))
      .def("__repr__", [](const MappedScan& s) {
        return "<lamina.MappedScan " + std::to_string(s.index) + ": " + StatusName(s) + ">";
      });
  py::class_<PyMapping>(*m, "Mapping", Doc("Mapping"))
      .def(py::init([](const std::string& config, const py::dict& options) {
             return std::make_unique<PyMapping>(ConfigOf(config, options));
           }),
           py::arg("config") = "", py::arg("options") = py::dict(), Doc("Mapping.__init__"))
      .def("add", &PyMapping::Add, py::arg("points"), py::arg("stamp_ns") = py::none(),
           py::arg("times") = py::none(), py::arg("recording") = "", Doc("Mapping.add"))
      .def("add_recording", &PyMapping::AddRecording, py::arg("recording"), py::arg("first") = 0,
           py::arg("last") = py::none(), Doc("Mapping.add_recording"))
      .def("finish", &PyMapping::Finish, Doc("Mapping.finish"))
      .def("trajectory", &PyMapping::Poses, py::arg("frame") = "map", Doc("Mapping.trajectory"))
      .def("surfels", &PyMapping::Surfels, py::arg("min_frames") = py::none(),
           Doc("Mapping.surfels"))
      .def_property_readonly("counts", &PyMapping::Counts, Doc("Mapping.counts"));
}

void BindRecordings(py::module_* m) {
  py::class_<PoseList>(*m, "Trajectory", Doc("Trajectory"))
      .def("__len__", [](const PoseList& p) { return p.poses.size(); })
      .def_property_readonly("stamps_ns", &PoseList::StampArray, Doc("Trajectory.stamps_ns"))
      .def_property_readonly("poses", &PoseList::Array, Doc("Trajectory.poses"))
      .def_property_readonly("skipped", &PoseList::SkippedArray, Doc("Trajectory.skipped"))
      .def_property_readonly("pieces", &PoseList::PieceArray, Doc("Trajectory.pieces"));
  py::class_<Scan>(*m, "Scan", Doc("Scan"))
      .def_readonly("stamp_ns", &Scan::stamp_ns, Doc("Scan.stamp_ns"))
      .def_property_readonly("points", &PointsOf, Doc("Scan.points"))
      .def_property_readonly("times", &TimesOf, Doc("Scan.times"));
  py::class_<Recording>(*m, "Recording", Doc("Recording"))
      .def(py::init([](const std::filesystem::path& path, const std::string& config,
                       const py::dict& options) {
             return std::make_unique<Recording>(path.string(), ConfigOf(config, options));
           }),
           py::arg("path"), py::arg("config") = "", py::arg("options") = py::dict())
      .def("__len__", &Recording::size)
      .def("__getitem__",
           [](const Recording& r, py::ssize_t i) {
             const std::size_t at = r.PlaceOf(i);
             const py::gil_scoped_release release;
             return r.source().Read(at);
           })
      .def(
          "name", [](const Recording& r, py::ssize_t i) { return r.source().Name(r.PlaceOf(i)); },
          py::arg("i"), Doc("Recording.name"));
}

}  // namespace

PYBIND11_MODULE(lamina, m) {
  m.doc() = Doc("");
  m.attr("__version__") = LAMINA_VERSION;
  py::register_exception<InputError>(m, "InputError", PyExc_ValueError).attr("__doc__") =
      Doc("InputError");
  py::register_exception<OptionError>(m, "OptionError", PyExc_ValueError).attr("__doc__") =
      Doc("OptionError");
  // First, so that signatures have names of Python for what mapping takes and gives.
  BindRecordings(&m);
  BindMapping(&m);
  m.def("read_trajectory", &ReadPoses, py::arg("path"), Doc("read_trajectory"));
  m.def("evaluate", &Evaluate, py::arg("estimate"), py::arg("truth"), py::arg("alignment") = "se3",
        Doc("evaluate"));
}

}  // namespace lamina::python
