// The way of a sensor whose place is unknown, until a finished map shows it.
//
// Its scans are mapped as a piece of their own, which nothing connects to the map. Every so many
// keyframes what they have gathered is looked for among the places of the map (place_index.h). The
// piece is found when two looks in a row, between which the sensor has moved on, say the same.
//
// What is decided when counts keyframes. Not thread-safe; deterministic.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "backend/localisation/place_index.h"
#include "backend/localisation/place_report.h"
#include "backend/submaps/submap.h"

namespace lamina {

class PlaceSearch {
 public:
  // What is looked for: all that the last keyframes have gathered, and those in the window.
  struct Query {
    Submap gathered;
    std::vector<FinalKeyframe> window;
  };

  // Throws OptionError.
  PlaceSearch(const LoopOptions& options, double leaf_size_m);

  // The next keyframe that has left the window.
  void Add(const FinalKeyframe& keyframe);
  // A keyframe has entered the window, here in the frame of the own piece.
  void CountKeyframe(const SE3& T_own_lidar);
  // Whether a look is due. Not while one runs.
  bool Due() const;
  // Of the keyframes that are in the window now; the next look is due so many after it.
  Query BeginLook(std::vector<FinalKeyframe> window);
  // Looks. Add() and CountKeyframe() may come meanwhile.
  std::optional<FoundPlace> Look(const Query& query, const PlaceIndex& places,
                                 const PlaceSource& map);
  // Whether what it has gathered lies in more than one place of a piece, as far as it has met any.
  bool ambiguous() const { return ambiguous_; }
  // What came of the last look, for a log line; empty before the first, and when it was believed.
  const std::string& reason() const { return reason_; }
  // What was compared for that look; not part of the state that is archived.
  const std::vector<PlaceCandidate>& candidates() const { return candidates_; }

  void Archive(StateArchive& a);

 private:
  bool HasMovedOnTo(const Eigen::Vector3d& sensor) const;
  // Whether the last look that was believed, followed in the map to here, says the same.
  bool Agrees(const FoundPlace& found, const Eigen::Vector3d& sensor,
              const std::vector<FinalKeyframe>& window, const PlaceIndex& places,
              const PlaceSource& map) const;
  // What the last keyframes have gathered.
  Submap Gathered(const std::vector<FinalKeyframe>& window) const;

  SubmapOptions options_;
  SubmapBuilder builder_;
  std::optional<Submap> complete_;  // the newest that is
  int keyframes_since_look_ = 0;
  Eigen::Vector3d newest_ = Eigen::Vector3d::Zero();  // keyframe
  std::int64_t looks_ = 0;
  bool ambiguous_ = false;
  std::string reason_;
  std::vector<PlaceCandidate> candidates_;
  // Of the last look that was believed: the best pose, and those in other pieces that are the same.
  std::vector<FoundPlace> last_;
  std::int64_t last_keyframe_ = -1;
  Eigen::Vector3d sensor_ = Eigen::Vector3d::Zero();  // in the own piece
};

}  // namespace lamina
