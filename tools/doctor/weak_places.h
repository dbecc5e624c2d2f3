// Where a run went badly: scans that follow one another and show the same symptom are one place.
//
// A symptom has a figure for each scan and a limit that does not depend on the run
// (tools/results/verdict/rules.h and the run's own configuration). How much a place harms is
//
//     harm = weight of the symptom * sqrt(extent),
//
// where the extent is the number of scans that show it, and of a gap the number of scans that are
// missing. So of two places alike in length the symptom decides, in the order of `Symptom`; many
// scans of a lesser one come before one of a greater.
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "tools/results/run_table.h"

namespace lamina {

// The worst first.
enum class Symptom {
  kLost,
  kNewPiece,
  kUnconverged,
  kSpeedJump,
  kTurnJump,
  kDegenerate,
  kFewInliers,
  kPoorFit,
  kResidual,
  kGap,
  kSkipped,
  kStampBackwards,
  kOverBudget,
  kSlow,
};

struct SymptomKind {
  Symptom symptom;
  const char* name;    // "lost"
  const char* figure;  // "share of inliers", of a chart
  const char* unit;    // may be empty
  double weight;
};

const std::vector<SymptomKind>& SymptomKinds();
const SymptomKind& KindOf(Symptom symptom);

struct WeakPlace {
  Symptom symptom = Symptom::kLost;
  std::size_t first = 0, last = 0;  // indices into RunTable::scans
  std::size_t count = 0;            // of the scans from first to last that show it
  double extent = 0.0;              // see above
  double worst = 0.0;               // figure of the scan that is worst, NaN if it has none
  std::size_t worst_at = 0;         // that scan
  double harm = 0.0;
  std::string reason;  // of skipped scans: their status
};

// A symptom's figure of each scan, NaN where it has none, and the limit beyond which it shows; NaN
// if something else than the figure tells.
struct SymptomFigures {
  std::vector<double> values;
  double limit = 0.0;
  bool low_is_bad = false;
};

// Thread-safe once constructed. `table` must outlive it.
class WeakPlaces {
 public:
  explicit WeakPlaces(const RunTable& table);

  // What harms most first; of places that harm alike, the one that comes first.
  const std::vector<WeakPlace>& places() const { return places_; }
  SymptomFigures Figures(Symptom symptom) const;
  // Whether scan i shows it.
  bool Shows(Symptom symptom, std::size_t i) const;
  // Where the scans of scan i's recording are usually apart, s; NaN if unknown.
  double UsualIntervalAt(std::size_t i) const;
  // Scans that are missing before scan i, by the time since the one before: 1 at least.
  double MissingBefore(std::size_t i) const;

 private:
  void FindMotions();
  void FindNewPieces();
  double FigureOf(Symptom symptom, std::size_t i) const;
  double ExtentOf(Symptom symptom, std::size_t i) const;
  void FindPlaces(Symptom symptom);
  void AddOverBudget();

  const RunTable& table_;
  // By recording: the usual interval between stamps, and the one from which on scans are missing.
  std::map<std::string, double> usual_interval_s_, gap_s_;
  std::vector<double> speed_change_, turn_change_;
  std::vector<bool> begins_piece_;
  std::vector<bool> young_;  // the map of its piece is of too few scans to judge a match by it
  std::vector<WeakPlace> places_;
};

}  // namespace lamina
