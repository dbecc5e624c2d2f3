#include "tools/doctor/data.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <set>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "io/map/surfel_reader.h"
#include "tools/report/page.h"
#include "tools/results/verdict/process_report.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// Every 2^k-th of points that come one by one, so that few enough remain.
class ThinnedPoints {
 public:
  explicit ThinnedPoints(std::size_t most) : most_(most) {}

  void Add(const Eigen::Vector3d& p) {
    if (seen_++ % stride_ != 0) return;
    points_.push_back(p.head<2>());
    if (points_.size() <= most_) return;
    for (std::size_t i = 0; 2 * i < points_.size(); ++i) points_[i] = points_[2 * i];
    points_.resize((points_.size() + 1) / 2);
    stride_ *= 2;
  }

  std::string Encode() const {
    std::vector<double> values;
    for (const Eigen::Vector2d& p : points_) values.insert(values.end(), {p.x(), p.y()});
    return Base64Floats(values);
  }

 private:
  std::size_t most_, seen_ = 0, stride_ = 1;
  std::vector<Eigen::Vector2d> points_;
};

constexpr std::size_t kMostPathPoints = 4000, kMostMapPoints = 8000;

// Where a place lies in the frame of its piece, and the map around it.
struct Surroundings {
  bool known = false;
  std::int64_t piece = 0;
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  double radius_m = 0.0;
  ThinnedPoints here{kMostPathPoints}, map{kMostMapPoints};
};

// The poses of the scans of a place; where none has one, the last pose before it.
Surroundings Surround(const RunTable& table, const WeakPlace& place) {
  Surroundings around;
  around.piece = table.scans[place.first].record.piece;
  Eigen::Vector2d low = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity());
  Eigen::Vector2d high = -low;
  const auto take = [&](std::size_t i) {
    const RunScan& scan = table.scans[i];
    if (!scan.has_pose || scan.record.piece != around.piece) return;
    const Eigen::Vector3d& t = scan.record.T_world_lidar.t;
    around.known = true;
    around.here.Add(t);
    low = low.cwiseMin(t.head<2>());
    high = high.cwiseMax(t.head<2>());
  };
  for (std::size_t i = place.first; i <= place.last; ++i) take(i);
  for (std::size_t i = place.first; i-- > 0 && !around.known;) take(i);
  if (!around.known) return around;
  constexpr double kAroundM = 15.0, kFarthestM = 80.0;
  around.centre = 0.5 * (low + high);
  around.radius_m = std::min(kFarthestM, kAroundM + 0.5 * (high - low).norm());
  return around;
}

// Surfels of the maps of all pieces that lie near the places.
void AddMaps(const std::string& folder, std::vector<Surroundings>* places, json* notes) {
  std::set<std::int64_t> pieces;
  for (const Surroundings& place : *places) {
    if (place.known) pieces.insert(place.piece);
  }
  for (const std::int64_t piece : pieces) {
    const std::string path = (fs::path(folder) / MapFileName(piece)).string();
    // A piece without surfaces has no file.
    if (piece != 0 && !fs::exists(path)) continue;
    try {
      SurfelReader reader(path);
      for (Surfel surfel; reader.Next(&surfel);) {
        for (Surroundings& place : *places) {
          const bool near =
              (surfel.centre.head<2>() - place.centre).cwiseAbs().maxCoeff() <= place.radius_m;
          if (place.known && place.piece == piece && near) place.map.Add(surfel.centre);
        }
      }
    } catch (const InputError& error) {
      notes->push_back(std::string(error.what()) + ": pictures are without the map");
    }
  }
}

json Paths(const RunTable& table, const std::vector<Surroundings>& places) {
  std::map<std::int64_t, ThinnedPoints> paths;
  for (const Surroundings& place : places) {
    if (place.known) paths.try_emplace(place.piece, kMostPathPoints);
  }
  for (const RunScan& scan : table.scans) {
    const auto path = paths.find(scan.record.piece);
    if (scan.has_pose && path != paths.end()) path->second.Add(scan.record.T_world_lidar.t);
  }
  json encoded = json::object();
  for (const auto& [piece, path] : paths) encoded[std::to_string(piece)] = path.Encode();
  return encoded;
}

// The symptom's figure at the place and around it. Of more scans than fit, the worst of each group.
json ChartOf(const DoctorFindings& findings, const WeakPlace& place) {
  constexpr std::size_t kAround = 30, kMostValues = 4000;
  const std::vector<RunScan>& scans = findings.table->scans;
  const SymptomFigures figures = findings.weak->Figures(place.symptom);
  const std::size_t begin = place.first - std::min(place.first, kAround);
  const std::size_t end = std::min(scans.size(), place.last + 1 + kAround);
  const std::size_t group = (end - begin + kMostValues - 1) / kMostValues;
  std::vector<double> numbers, values;
  for (std::size_t i = begin; i < end; ++i) {
    const double value = figures.values[i];
    if ((i - begin) % group == 0) {
      numbers.push_back(static_cast<double>(scans[i].record.scan));
      values.push_back(value);
    } else if (std::isnan(values.back()) ||
               (figures.low_is_bad ? value < values.back() : value > values.back())) {
      values.back() = value;
    }
  }
  if (std::none_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); })) {
    return nullptr;
  }
  const SymptomKind& kind = KindOf(place.symptom);
  return {{"title", kind.figure},
          {"unit", kind.unit},
          {"scan", Base64Floats(numbers)},
          {"values", Base64Floats(values)},
          {"limit", NumberOrNull(figures.limit)},
          {"band", {scans[place.first].record.scan, scans[place.last].record.scan}}};
}

json PictureOf(const Surroundings& around) {
  if (!around.known) return nullptr;
  return {{"piece", std::to_string(around.piece)},
          {"here", around.here.Encode()},
          {"map", around.map.Encode()},
          {"centre", {around.centre.x(), around.centre.y()}},
          {"radius_m", around.radius_m}};
}

}  // namespace

json DoctorData(const DoctorFindings& findings) {
  const RunTable& table = *findings.table;
  const std::vector<WeakPlace>& places = findings.weak->places();
  std::vector<Surroundings> around;
  for (std::size_t i = 0; i < findings.advice.size(); ++i) {
    around.push_back(Surround(table, places[i]));
  }
  json notes = table.notes;
  AddMaps(table.folder, &around, &notes);
  json told = json::array();
  for (std::size_t i = 0; i < findings.advice.size(); ++i) {
    const PlaceAdvice& advice = findings.advice[i];
    told.push_back({{"symptom", KindOf(places[i].symptom).name},
                    {"where", advice.where},
                    {"files", NameFiles(findings, places[i])},
                    {"measured", advice.measured},
                    {"cause", advice.cause},
                    {"settings", advice.settings},
                    {"record", advice.record},
                    {"beside", PlacesBeside(findings, i)},
                    {"chart", ChartOf(findings, places[i])},
                    {"picture", PictureOf(around[i])}});
  }
  return {{"name", fs::absolute(fs::path(table.folder) / "").parent_path().filename().string()},
          {"outline", DescribeRun(table)},
          {"verdict", findings.verdict ? ToJson(*findings.verdict) : json()},
          {"notes", notes},
          {"found", places.size()},
          {"paths", Paths(table, around)},
          {"places", told}};
}

}  // namespace lamina
