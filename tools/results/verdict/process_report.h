// What a run tells about itself: frames.csv while it goes on, summary.json at its end.
#pragma once

#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "backend/mapping/mapped_scan.h"
#include "backend/mapping/report.h"
#include "io/file/file_writer.h"
#include "io/store/scan_record.h"
#include "tools/results/verdict/verdict.h"

namespace lamina {

// A part of the map that no match connects to the others: poses of different pieces are in
// different frames.
struct PieceFigures {
  std::string recording;  // the folder that its scans came from
  std::int64_t first_scan = 0, last_scan = 0;
  std::size_t frames = 0, lost = 0;
  bool recorded_stamps = true;  // of all frames; made up otherwise
};

// A line for each scan, in order. Distances in metres, angles in radians, covariance of the pose's
// tangent [rotation; translation] (core/geometry/se3.h). Throws OutputError. Not thread-safe.
class FrameTable {
 public:
  // max_iterations: see VerdictCounter.
  FrameTable(const std::string& path, int max_iterations);
  void Append(const ScanRecord& scan);
  void Commit() { writer_.Commit(); }
  // Those of the scans so far, by number.
  const std::map<std::int64_t, PieceFigures>& pieces() const { return pieces_; }
  // Pieces that lie in the frame of another, by their number.
  void Join(const std::map<std::int64_t, std::int64_t>& joins);
  // The pieces of each frame together, by the number of the frame.
  std::map<std::int64_t, PieceFigures> FramesOfPieces() const;
  // For summary.json.
  nlohmann::json PiecesToJson() const;
  RunVerdict Judge() const { return verdict_.Judge(); }

 private:
  void CountPiece(const ScanRecord& scan);
  std::int64_t FrameOf(std::int64_t piece) const;

  FileWriter writer_;
  std::map<std::int64_t, PieceFigures> pieces_;
  std::map<std::int64_t, std::int64_t> joins_;
  VerdictCounter verdict_;
};

// CPU seconds of this process so far, all threads.
double ProcessCpuSeconds();

// Largest resident set of this process so far.
std::size_t PeakRssBytes();

// Resident set of this process now; 0 if the system does not tell.
std::size_t ResidentBytes();

struct RunFigures {
  double opening_s = 0.0;            // before the first scan was mapped
  double wall_s = 0.0, cpu_s = 0.0;  // from then on
  std::size_t map_surfels = 0;
  std::size_t map_peak_bytes = 0;
  bool map_over_budget = false;  // at any time
  bool interrupted = false;
};

// Says that a scan began a piece of the map, and where.
std::string NewPieceMessage(const MappedScan& report);

// Tells where the files of a run or a session lie.
void PrintOutputs(const std::string& folder);

// The file of a piece's map, in the frame of that piece: a viewer that draws pieces over one
// another would show what never was.
std::string MapFileName(std::int64_t piece);

// The piece that a file's name is of, of the kind that `name_of` names; nothing if that gives no
// piece this name, or if the name has no number.
std::optional<std::int64_t> PieceOfFile(const std::string& name,
                                        std::string (*name_of)(std::int64_t piece));

// Removes the files of this kind that an earlier run has left: it may have had more pieces.
void RemovePieceFiles(const std::string& folder, std::string (*name_of)(std::int64_t piece));

// Frames that must have seen a plane that is written: as configured, but no more than there are
// keyframes. A single scan is a map, too.
int LeastSurfelFrames(int configured, const MappingCounts& counts);

// Writes the surfaces that at least min_frames frames have seen, a file for each piece; returns
// their number.
std::size_t WriteMap(const std::string& folder, const VoxelMap& map, int min_frames);

// What summary.json holds; names of folders, which may be in any encoding, are part of it: what is
// no UTF-8 is replaced.
std::string SummaryText(const nlohmann::json& summary);

// Null for what JSON has no number for.
nlohmann::json NumberOrNull(double value);

// For summary.json.
nlohmann::json ToJson(const std::map<std::int64_t, PieceFigures>& pieces);

nlohmann::json Summarise(const MappingCounts& counts, const VoxelMap& map,
                         const RunFigures& figures);

}  // namespace lamina
