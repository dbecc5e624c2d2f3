#include "tools/run/joined_run.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "io/file/file_writer.h"
#include "io/file/text_input.h"
#include "tools/results/graph_file.h"
#include "tools/results/piece_poses.h"

namespace lamina {

JoinedRun::JoinedRun(Pieces pieces, const LaminaConfig& config) : pieces_(std::move(pieces)) {
  std::vector<MapPiece> parts;
  for (const auto& [piece, closure] : pieces_) {
    numbers_.push_back(piece);
    parts.push_back({&closure->submaps(), closure->graph()});
  }
  joined_ = JoinPieces(parts, config.loops, config.map, config.frontend.matcher);
  if (moved()) Adjust(parts, config);
  for (std::size_t p = 0; p < numbers_.size(); ++p) {
    const auto first =
        joined_.graph.poses.begin() + static_cast<std::ptrdiff_t>(joined_.first_submap[p]);
    std::vector<SE3>& anchors = anchors_[numbers_[p]];
    const std::vector<Submap>& submaps = *parts[p].submaps;
    anchors.assign(first, first + static_cast<std::ptrdiff_t>(submaps.size()));
    corrections_.try_emplace(numbers_[p], submaps, anchors, pieces_.at(numbers_[p])->trimmed());
  }
}

void JoinedRun::Adjust(const std::vector<MapPiece>& parts, const LaminaConfig& config) {
  std::vector<const Submap*> submaps;
  for (const MapPiece& part : parts) {
    for (const Submap& submap : *part.submaps) submaps.push_back(&submap);
  }
  bundle_ = AdjustSubmaps(submaps, joined_.graph, config.loops.bundle, config.map);
  joined_.graph.poses = bundle_.anchors;
}

bool JoinedRun::moved() const { return !joined_.graph.loops.empty(); }

std::size_t JoinedRun::PositionOf(std::int64_t piece) const {
  return static_cast<std::size_t>(std::lower_bound(numbers_.begin(), numbers_.end(), piece) -
                                  numbers_.begin());
}

std::int64_t JoinedRun::FrameOf(std::int64_t piece) const {
  if (pieces_.count(piece) == 0) return piece;
  return numbers_[joined_.part[PositionOf(piece)]];
}

std::map<std::int64_t, std::int64_t> JoinedRun::joins() const {
  std::map<std::int64_t, std::int64_t> joins;
  for (const std::int64_t piece : numbers_) {
    if (FrameOf(piece) != piece) joins[piece] = FrameOf(piece);
  }
  return joins;
}

SE3 JoinedRun::Corrected(std::int64_t piece, StampNs stamp_ns, const SE3& T_world_lidar) const {
  const auto found = corrections_.find(piece);
  if (!moved() || found == corrections_.end()) return T_world_lidar;
  return found->second.Corrected(stamp_ns, T_world_lidar);
}

void JoinedRun::AddTo(VoxelMap* map) const {
  for (const auto& [piece, closure] : pieces_) {
    const std::int64_t frame = FrameOf(piece);
    if (map->HasPiece(frame)) {
      map->SelectPiece(frame);
    } else {
      map->BeginPiece(frame);
    }
    AddToMap(closure->submaps(), anchors_.at(piece), map);
  }
}

std::vector<std::size_t> JoinedRun::SubmapsOfFrame(std::int64_t frame) const {
  std::vector<std::size_t> submaps;
  for (std::size_t i = 0; i < joined_.graph.poses.size(); ++i) {
    if (FrameOf(PieceOfSubmap(i)) == frame) submaps.push_back(i);
  }
  return submaps;
}

std::vector<SubmapFrameView> JoinedRun::Frames() const {
  std::vector<SubmapFrameView> frames;
  for (const auto& [piece, closure] : pieces_) {
    if (FrameOf(piece) != piece) continue;
    SubmapFrameView frame;
    frame.frame = piece;
    const std::vector<std::size_t> submaps = SubmapsOfFrame(piece);
    for (const std::size_t i : submaps) {
      const std::int64_t of = PieceOfSubmap(i);
      frame.pieces.push_back(of);
      frame.submaps.push_back(&pieces_.at(of)->submaps()[NumberInPiece(i)]);
    }
    AddTrimmed(submaps, &frame);
    frame.graph = PartOfGraph(joined_.graph, submaps);
    frames.push_back(std::move(frame));
  }
  return frames;
}

void JoinedRun::AddTrimmed(const std::vector<std::size_t>& submaps, SubmapFrameView* frame) const {
  for (std::size_t position = 0; position < submaps.size(); ++position) {
    if (NumberInPiece(submaps[position]) != 0) continue;
    const std::int64_t piece = PieceOfSubmap(submaps[position]);
    const std::vector<TrimmedSubmap>& trimmed = pieces_.at(piece)->trimmed();
    if (!trimmed.empty())
      frame->trimmed[piece] = Shifted(trimmed, static_cast<std::ptrdiff_t>(position));
  }
}

std::int64_t JoinedRun::PieceOfSubmap(std::size_t submap) const {
  const auto& first = joined_.first_submap;
  const auto after = std::upper_bound(first.begin(), first.end(), submap);
  return numbers_[static_cast<std::size_t>(after - first.begin()) - 1];
}

std::size_t JoinedRun::NumberInPiece(std::size_t submap) const {
  return submap - joined_.first_submap[PositionOf(PieceOfSubmap(submap))];
}

void AddFrameColumn(const std::string& frames_csv,
                    const std::map<std::int64_t, std::int64_t>& joins) {
  const std::string text = ReadFile(frames_csv);
  LineReader lines(frames_csv, text);
  FileWriter writer(frames_csv);
  lines.Next();
  const std::vector<std::string_view> names = SplitAtCommas(lines.line());
  const auto column =
      static_cast<std::size_t>(std::find(names.begin(), names.end(), "piece") - names.begin());
  writer.Write(fmt::format("{},frame\n", lines.line()));
  while (lines.Next()) {
    double piece = 0.0;
    if (!ParseNumber(SplitAtCommas(lines.line()).at(column), &piece))
      lines.Fail("piece must be a whole number");
    const auto join = joins.find(static_cast<std::int64_t>(piece));
    writer.Write(
        fmt::format("{},{}\n", lines.line(),
                    join == joins.end() ? static_cast<std::int64_t>(piece) : join->second));
  }
  writer.Commit();
}

}  // namespace lamina
