#include "tools/localise/trial.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include "backend/localisation/map_places.h"
#include "backend/localisation/place_index.h"
#include "backend/loops/piece_loops.h"
#include "backend/mapping/mapping.h"
#include "config/config.h"
#include "core/base/angle.h"
#include "tools/metrics/trajectory_metrics.h"
#include "tools/synth/command.h"
#include "tools/synth/engine/random.h"

namespace lamina {
namespace {

// All scans of a window on the map are so near to one of the map, in metres; off it, so far.
constexpr double kOnMapM = 4.0, kOffMapM = 45.0;
constexpr int kMostDraws = 2000;
// Another place of the same kind.
constexpr int kOtherSeed = 7000;
constexpr StampNs kScanNs = 100'000'000, kDarkNs = 30'000'000'000;

SynthOptions DriveOptions(const std::string& options, int seed, const std::string& more = "") {
  std::vector<std::string> texts = {options, fmt::format("--seed {}", seed)};
  if (!more.empty()) texts.push_back(more);
  return ParseSynthOptions(texts);
}

double RotationDeg(const SE3& a, const SE3& b) { return Degrees(RotationAngle(a, b)); }

// A keyframe of the map.
struct MapPose {
  std::int64_t piece = 0;
  SE3 T_piece_lidar, T_scene_lidar;
};

class CaseTrial {
 public:
  CaseTrial(const LocalisationCase& place, int seed, const LocalisationTrialOptions& options)
      : place_(place),
        seed_(seed),
        options_(options),
        mapping_options_(MappingOptionsOf(place, options)),
        random_(synth::HashOf({seed, 0x10ca})) {
    trial_.name = place.name;
    trial_.seed = seed;
  }

  LocalisationTrial Run() {
    if (options_.lost) {
      BeginDrive();
    } else {
      MakeMap();
    }
    const int windows = static_cast<int>(options_.window_s / 0.1);
    const SynthSequence visit(DriveOptions(place_.map, seed_, place_.visit));
    RunWindows(WindowKind::kOnMap, options_.on_map, visit, windows);
    RunWindows(WindowKind::kOffMap, options_.off_map, visit, windows);
    if (place_.elsewhere != "-") {
      const SynthSequence other(ElsewhereOptions());
      RunWindows(WindowKind::kElsewhere, options_.elsewhere, other, windows);
    }
    return std::move(trial_);
  }

 private:
  static MappingOptions MappingOptionsOf(const LocalisationCase& place,
                                         const LocalisationTrialOptions& options) {
    MappingOptions mapping = LoadConfig(place.config, options.set).Mapping();
    mapping.loops.enabled = true;
    return mapping;
  }

  SynthOptions ElsewhereOptions() const {
    const int seed = seed_ + kOtherSeed;
    return place_.elsewhere.empty() ? DriveOptions(place_.map, seed, place_.visit)
                                    : DriveOptions(place_.elsewhere, seed);
  }

  void MakeMapping() {
    MappingCallbacks callbacks;
    callbacks.on_look = [this](const PlaceReport& report) { OnLook(report); };
    callbacks.on_scan = [this](const MappedScan& report) { last_ = report; };
    localiser_ = std::make_unique<Mapping>(mapping_options_, callbacks);
  }

  void MakeMap() {
    drive_.emplace(DriveOptions(place_.map, seed_));
    Mapping mapped(mapping_options_);
    for (std::size_t i = 0; i < drive_->size(); ++i) mapped.Add(drive_->Generate(i));
    mapped.Finish();
    MakeMapping();
    mapped.loops()->AddCorrectedTo(&localiser_->map());
    CollectMap(*mapped.loops());
    localiser_->StartLocalising(places_);
  }

  void BeginDrive() {
    drive_.emplace(DriveOptions(place_.map, seed_));
    MakeMapping();
    for (std::size_t i = 0; i < drive_->size(); ++i) localiser_->Add(drive_->Generate(i));
    drive_end_ns_ = stamp_ns_ = last_.stamp_ns;
    CollectMap(*localiser_->loops());
  }

  // Keyframes of the drive as the map has them now.
  void CollectMap(const PieceLoops& loops) {
    map_.clear();
    places_.clear();
    trial_.pieces = 0;
    Trajectory estimate, truth;
    const double spacing_m = PlaceIndex::SpacingM(mapping_options_.loops);
    for (const auto& [piece, closure] : loops.pieces()) {
      std::vector<Eigen::Vector3d> way;
      for (std::size_t i = 0; i < closure->submaps().size(); ++i) {
        for (const SubmapKeyframe& keyframe : closure->submaps()[i].keyframes) {
          if (keyframe.stamp_ns > drive_end_ns_) continue;
          const SE3 T_piece_lidar = closure->anchors()[i] * keyframe.T_submap_lidar;
          const SE3 T_true = drive_->TruePoseAt(SecondsBetween(0, keyframe.stamp_ns));
          way.push_back(T_piece_lidar.t);
          estimate.push_back({keyframe.stamp_ns, T_piece_lidar});
          truth.push_back({keyframe.stamp_ns, T_true});
          map_.push_back({piece, T_piece_lidar, drive_->T_scene_world() * T_true});
        }
      }
      if (way.empty()) continue;
      AddPlaces(piece, way, spacing_m, &places_);
      ++trial_.pieces;
    }
    trial_.places = places_.size();
    const SE3 align = AlignTrajectories(estimate, truth, Alignment::kSe3);
    double squares = 0.0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      squares += (align * estimate[i].T_world_lidar.t - truth[i].T_world_lidar.t).squaredNorm();
    }
    trial_.map_error_m =
        std::sqrt(squares / static_cast<double>(std::max<std::size_t>(1, truth.size())));
  }

  double NearestM(const Eigen::Vector3d& scene) const {
    double nearest = std::numeric_limits<double>::infinity();
    for (const MapPose& pose : map_)
      nearest = std::min(nearest, (pose.T_scene_lidar.t - scene).norm());
    return nearest;
  }

  // The first scan of a window of this kind; nothing if there seems to be none.
  std::optional<std::size_t> DrawWindow(WindowKind kind, const SynthSequence& visit, int scans) {
    for (int draw = 0; draw < kMostDraws; ++draw) {
      const int last = static_cast<int>(visit.size()) - scans;
      if (last < 0) return std::nullopt;
      const auto first = static_cast<std::size_t>(random_.Index(last + 1));
      if (kind == WindowKind::kElsewhere) return first;
      bool fits = true;
      double way_m = 0.0;
      std::optional<Eigen::Vector3d> before;
      for (int i = 0; i < scans && fits; i += 5) {
        const Eigen::Vector3d at =
            (visit.T_scene_world() * visit.TruePose(first + static_cast<std::size_t>(i))).t;
        if (before) way_m += (at - *before).norm();
        before = at;
        const double nearest = NearestM(at);
        fits = kind == WindowKind::kOnMap ? nearest < kOnMapM : nearest > kOffMapM;
      }
      // A sensor that stands is not asked.
      if (fits && way_m > 1.0) return first;
    }
    return std::nullopt;
  }

  void RunWindows(WindowKind kind, int count, const SynthSequence& visit, int scans) {
    for (int i = 0; i < count; ++i) {
      const std::optional<std::size_t> first = DrawWindow(kind, visit, scans);
      if (!first) return;
      WindowResult window;
      window.kind = kind;
      window.first_scan = *first;
      window.reversed = random_.Chance(0.5);
      window.yaw_deg = random_.Uniform(-180.0, 180.0);
      window.tilt_deg = random_.Uniform(0.0, 2.0 * place_.tilt_deg);
      const double about = random_.Uniform(0.0, 2.0 * M_PI);
      const Eigen::Vector3d axis(std::cos(about), std::sin(about), 0.0);
      carrier_ = SE3(
          Eigen::Quaterniond(Eigen::AngleAxisd(window.yaw_deg * kDegree, Eigen::Vector3d::UnitZ()) *
                             Eigen::AngleAxisd(window.tilt_deg * kDegree, axis)),
          Eigen::Vector3d::Zero());
      window_ = &window;
      RunWindow(visit, scans);
      trial_.windows.push_back(std::move(window));
    }
  }

  void RunWindow(const SynthSequence& visit, int scans) {
    const std::string name = fmt::format("window {}", trial_.windows.size());
    claim_.reset();
    furthest_ = 0;
    window_->stage = "no look";
    T_scene_before_.reset();
    for (int i = 0; i < scans && !claim_; ++i) {
      const std::size_t k =
          window_->first_scan + static_cast<std::size_t>(window_->reversed ? scans - 1 - i : i);
      Scan scan = visit.Generate(k);
      const Eigen::Matrix3f R = carrier_.R().transpose().cast<float>();
      for (ScanPoint& point : scan.points) {
        const Eigen::Vector3f p = R * Eigen::Vector3f(point.x, point.y, point.z);
        point.x = p.x(), point.y = p.y(), point.z = p.z();
      }
      stamp_ns_ += i == 0 && options_.lost ? kDarkNs : kScanNs;
      scan.stamp_ns = options_.lost ? stamp_ns_ : i * kScanNs;
      T_scene_lidar_ = visit.T_scene_world() * visit.TruePose(k) * carrier_;
      if (T_scene_before_) window_->way_m += (T_scene_lidar_.t - T_scene_before_->t).norm();
      T_scene_before_ = T_scene_lidar_;
      now_s_ = 0.1 * i;
      localiser_->Add(scan, options_.lost ? "" : name);
      if (options_.lost && !claim_) CheckMatched();
    }
    own_pieces_.insert(begun_.begin(), begun_.end());
    begun_.clear();
  }

  // A scan that is matched to what was mapped before has claimed a place.
  void CheckMatched() {
    if (last_.skipped || last_.odometry.status == OdometryFrame::Status::kLost) return;
    const bool of_map = std::any_of(map_.begin(), map_.end(),
                                    [&](const MapPose& pose) { return pose.piece == last_.piece; });
    if (of_map || own_pieces_.count(last_.piece) > 0) {
      Claim({last_.piece, last_.T_map_world});
    } else {
      begun_[last_.piece] = {window_->kind == WindowKind::kElsewhere,
                             T_scene_lidar_ * last_.odometry.T_world_lidar.Inverse()};
    }
  }

  void Claim(const FoundPlace& place) {
    if (options_.lost) CollectMap(*localiser_->loops());
    claim_ = place;
    window_->claimed = true;
    window_->after_s = now_s_;
    Judge(place, last_.odometry.T_world_lidar, &window_->error_m, &window_->error_deg);
    window_->right = window_->error_m <= kRightM && window_->error_deg <= kRightDeg;
  }

  // How far off a claim is, by the keyframe of the map that is near and agrees with it best: where
  // the map itself is torn, it has the sensor in two places.
  void Judge(const FoundPlace& place, const SE3& T_own_lidar, double* error_m,
             double* error_deg) const {
    constexpr double kNearM = 5.0;
    const SE3 T_piece_lidar = place.T_piece_own * T_own_lidar;
    *error_m = 1e3;
    *error_deg = 180.0;
    const bool elsewhere = window_->kind == WindowKind::kElsewhere;
    const auto own = own_pieces_.find(place.piece);
    if (own != own_pieces_.end() && own->second.elsewhere == elsewhere) {
      const SE3 expected = own->second.T_scene_piece.Inverse() * T_scene_lidar_;
      *error_m = (expected.t - T_piece_lidar.t).norm();
      *error_deg = RotationDeg(expected, T_piece_lidar);
    }
    if (elsewhere) return;
    const auto expected = [&](const MapPose& pose) {
      return pose.T_piece_lidar * pose.T_scene_lidar.Inverse() * T_scene_lidar_;
    };
    const double reach_m = std::max(kNearM, NearestM(T_scene_lidar_.t));
    for (const MapPose& pose : map_) {
      if (pose.piece != place.piece || (pose.T_scene_lidar.t - T_scene_lidar_.t).norm() > reach_m)
        continue;
      const double off_m = (expected(pose).t - T_piece_lidar.t).norm();
      const double off_deg = RotationDeg(expected(pose), T_piece_lidar);
      if (off_m / kRightM + off_deg / kRightDeg >= *error_m / kRightM + *error_deg / kRightDeg)
        continue;
      *error_m = off_m;
      *error_deg = off_deg;
    }
  }

  void OnLook(const PlaceReport& report) {
    if (window_ == nullptr) return;  // of the drive itself
    window_->reasons.push_back(report.reason.empty() ? (report.found ? "found" : "believed once")
                                                     : report.reason);
    Reach(report);
    if (report.found) Claim(*report.found);
  }

  // How far the right pose came at this look.
  void Reach(const PlaceReport& report) {
    const auto reach = [&](int stage, const std::string& what) {
      if (stage < furthest_) return;
      furthest_ = stage;
      window_->stage = what;
    };
    reach(0, "not among the candidates");
    for (std::size_t i = 0; i < report.candidates.size(); ++i) {
      const PlaceCandidate& candidate = report.candidates[i];
      double error_m = 0.0, error_deg = 0.0;
      Judge(candidate.place, last_.odometry.T_world_lidar, &error_m, &error_deg);
      window_->compared.push_back({now_s_, error_m, error_deg, candidate});
      if (error_m > kRightM || error_deg > kRightDeg) continue;
      if (report.found) reach(4, "found");
      if (i == 0 && candidate.reason.empty()) reach(3, "believed once");
      if (i > 0 && candidate.reason.empty()) reach(2, "another fits better");
      reach(1, candidate.reason);
    }
  }

  const LocalisationCase& place_;
  int seed_;
  const LocalisationTrialOptions& options_;
  MappingOptions mapping_options_;
  synth::HashStream random_;
  LocalisationTrial trial_;
  std::optional<SynthSequence> drive_;
  std::unique_ptr<Mapping> localiser_;
  std::vector<MapPose> map_;
  std::vector<MapPlace> places_;
  // Of a sensor that is lost while it maps.
  struct OwnPiece {
    bool elsewhere = false;
    SE3 T_scene_piece;
  };
  std::map<std::int64_t, OwnPiece> own_pieces_, begun_;  // of the windows before, of this one
  StampNs drive_end_ns_ = std::numeric_limits<StampNs>::max(), stamp_ns_ = 0;

  // Of the window under way.
  WindowResult* window_ = nullptr;
  SE3 carrier_;
  SE3 T_scene_lidar_;
  std::optional<SE3> T_scene_before_;
  double now_s_ = 0.0;
  int furthest_ = 0;
  MappedScan last_;
  std::optional<FoundPlace> claim_;
};

}  // namespace

const char* ToString(WindowKind kind) {
  switch (kind) {
    case WindowKind::kOnMap:
      return "on the map";
    case WindowKind::kOffMap:
      return "off the map";
    case WindowKind::kElsewhere:
      return "elsewhere";
  }
  return "";
}

LocalisationTrial RunLocalisationTrial(const LocalisationCase& place, int seed,
                                       const LocalisationTrialOptions& options) {
  return CaseTrial(place, seed, options).Run();
}

}  // namespace lamina
