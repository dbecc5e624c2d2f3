#include "tools/results/submap_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string_view>
#include <utility>

#include "core/base/error.h"
#include "core/geometry/state_archive.h"
#include "io/file/section_file.h"

namespace lamina {

namespace {

constexpr SectionFileKind kKind = {"LAMINASM", 1, "a file of submaps"};
constexpr std::string_view kFrame = "FRAM", kTrimmed = "TRIM", kSubmap = "SUBM";

}  // namespace

// Found by the archive, which looks in the namespace of what it writes.
void Archive(StateArchive& a, AnchorEdge* e) {
  std::uint64_t from = e->from, to = e->to;
  a(&from, &to, &e->T_from_to, &e->information);
  e->from = static_cast<std::size_t>(from);
  e->to = static_cast<std::size_t>(to);
}

namespace {

bool IsPose(const SE3& T) {
  constexpr double kRounding = 1e-6;
  return T.t.allFinite() && std::abs(T.q.coeffs().norm() - 1.0) < kRounding;
}

// What is wrong with it; empty if nothing is.
std::string Fault(const AnchorGraph& graph) {
  if (!std::all_of(graph.poses.begin(), graph.poses.end(), IsPose)) return "an anchor is no pose";
  for (const auto* edges : {&graph.odometry, &graph.loops}) {
    for (const AnchorEdge& edge : *edges) {
      if (std::max(edge.from, edge.to) >= graph.poses.size() || edge.from == edge.to)
        return "an edge is of a submap that there is not";
      if (!IsPose(edge.T_from_to) || !edge.information.allFinite())
        return "an edge has numbers that cannot be";
    }
  }
  return "";
}

bool IsLeaf(const SubmapLeaf& leaf, double leaf_size_m) {
  const auto within = [&](float x) { return std::abs(static_cast<double>(x)) <= leaf_size_m; };
  const PackedCluster& c = leaf.cluster;
  return std::isfinite(c.count) && c.count >= 0.0F && std::all_of(c.mean, c.mean + 3, within) &&
         std::all_of(c.covariance, c.covariance + 6, [](float x) { return std::isfinite(x); });
}

std::string Fault(const Submap& submap) {
  if (!(submap.leaf_size_m > 0.0) || !std::isfinite(submap.leaf_size_m))
    return "leaf_size_m must be > 0";
  if (!(submap.way_m >= 0.0) || !std::isfinite(submap.way_m)) return "way_m must be >= 0";
  if (submap.keyframes.empty()) return "it has no keyframe";
  if (!IsPose(submap.T_world_submap)) return "its anchor is no pose";
  for (const SubmapKeyframe& keyframe : submap.keyframes) {
    if (!IsPose(keyframe.T_submap_lidar)) return "a keyframe has no pose";
  }
  for (std::size_t i = 0; i < submap.leaves.size(); ++i) {
    const SubmapLeaf& leaf = submap.leaves[i];
    if (!IsLeaf(leaf, submap.leaf_size_m)) return fmt::format("leaf {} is no cluster", i);
    if (i == 0) continue;
    const SubmapLeaf& before = submap.leaves[i - 1];
    if (!std::lexicographical_compare(before.index, before.index + 3, leaf.index, leaf.index + 3))
      return fmt::format("leaf {} is out of order", i);
  }
  return "";
}

// The sections of a file, checked.
class SubmapReader {
 public:
  explicit SubmapReader(const std::string& path) : path_(path), reader_(path, kKind) {}

  std::vector<SubmapFrame> Read() {
    std::vector<SubmapFrame> frames;
    std::string tag, bytes;
    while (reader_.Next(&tag, &bytes)) {
      StateArchive archive{std::string_view(bytes)};
      if (tag == kFrame) {
        if (!frames.empty()) CheckWhole(frames.back());
        frames.push_back(ReadFrame(archive));
      } else if (tag == kTrimmed && !frames.empty() && frames.back().submaps.empty()) {
        ReadTrimmed(archive, &frames.back());
      } else if (tag == kSubmap && !frames.empty()) {
        ReadSubmap(archive, &frames.back());
      } else {
        Fail("has a section that does not belong there");
      }
      if (archive.unread() > 0) Fail("has a section that is too long");
    }
    if (!frames.empty()) CheckWhole(frames.back());
    return frames;
  }

 private:
  [[noreturn]] void Fail(const std::string& what) const {
    throw InputError(fmt::format("{}: {}", path_, what));
  }
  template <typename... T>
  void Take(StateArchive& archive, T*... values) const {
    try {
      archive(values...);
    } catch (const InputError& error) {
      Fail(error.what());
    }
  }
  SubmapFrame ReadFrame(StateArchive& archive) const {
    SubmapFrame frame;
    Take(archive, &frame.frame, &frame.graph.poses, &frame.graph.odometry, &frame.graph.loops);
    const std::string fault = Fault(frame.graph);
    if (!fault.empty()) Fail(fmt::format("frame {}: {}", frame.frame, fault));
    frame.graph.kept_before.assign(frame.graph.loops.size(), true);
    return frame;
  }
  void ReadTrimmed(StateArchive& archive, SubmapFrame* frame) const {
    std::vector<std::int64_t> pieces;
    std::vector<TrimmedSubmap> trimmed;
    Take(archive, &pieces, &trimmed);
    if (pieces.size() != trimmed.size()) Fail("has trimmed submaps of no piece");
    for (std::size_t i = 0; i < trimmed.size(); ++i) {
      std::vector<TrimmedSubmap>& of_piece = frame->trimmed[pieces[i]];
      if (trimmed[i].holder >= frame->graph.poses.size() || !IsPose(trimmed[i].T_world_submap) ||
          !IsPose(trimmed[i].T_holder_submap) ||
          (!of_piece.empty() && trimmed[i].middle_ns < of_piece.back().middle_ns))
        Fail(fmt::format("frame {}: trimmed submap {} cannot be", frame->frame, i));
      of_piece.push_back(trimmed[i]);
    }
  }
  void ReadSubmap(StateArchive& archive, SubmapFrame* frame) const {
    std::int64_t piece = 0;
    Submap submap;
    Take(archive, &piece, &submap);
    std::string fault = Fault(submap);
    const bool first = frame->pieces.empty() || frame->pieces.back() != piece;
    // Those between them were trimmed.
    if (submap.id < 0 || (!first && submap.id <= frame->submaps.back().id))
      fault = "it does not follow the one before";
    if (!fault.empty()) Fail(fmt::format("submap {} of piece {}: {}", submap.id, piece, fault));
    frame->pieces.push_back(piece);
    frame->submaps.push_back(std::move(submap));
  }
  void CheckWhole(const SubmapFrame& frame) const {
    if (frame.submaps.size() != frame.graph.poses.size()) {
      Fail(fmt::format("frame {}: {} submaps and {} anchors", frame.frame, frame.submaps.size(),
                       frame.graph.poses.size()));
    }
    for (const auto& [piece, trimmed] : frame.trimmed) {
      for (const TrimmedSubmap& submap : trimmed) {
        if (frame.pieces[submap.holder] != piece)
          Fail(fmt::format("frame {}: a trimmed submap of piece {} has no holder", frame.frame,
                           piece));
      }
    }
  }

  std::string path_;
  SectionReader reader_;
};

}  // namespace

std::vector<TrimmedSubmap> Shifted(std::vector<TrimmedSubmap> trimmed, std::ptrdiff_t positions) {
  for (TrimmedSubmap& submap : trimmed) {
    submap.holder =
        static_cast<std::size_t>(static_cast<std::ptrdiff_t>(submap.holder) + positions);
  }
  return trimmed;
}

std::vector<SubmapFrameView> FramesOf(const std::map<std::int64_t, const LoopClosure*>& pieces) {
  std::vector<SubmapFrameView> frames;
  for (const auto& [piece, closure] : pieces) {
    if (closure->submaps().empty()) continue;
    SubmapFrameView& frame = frames.emplace_back();
    frame.frame = piece;
    frame.graph = closure->graph();
    if (!closure->trimmed().empty()) frame.trimmed[piece] = closure->trimmed();
    for (const Submap& submap : closure->submaps()) {
      frame.pieces.push_back(piece);
      frame.submaps.push_back(&submap);
    }
  }
  return frames;
}

namespace {

void WriteTrimmed(const FrameTrimmings& of_pieces, SectionWriter* writer) {
  std::vector<std::int64_t> pieces;
  std::vector<TrimmedSubmap> trimmed;
  for (const auto& [piece, of_piece] : of_pieces) {
    pieces.insert(pieces.end(), of_piece.size(), piece);
    trimmed.insert(trimmed.end(), of_piece.begin(), of_piece.end());
  }
  if (trimmed.empty()) return;
  StateArchive archive;
  archive(&pieces, &trimmed);
  writer->Write(kTrimmed, archive.written());
}

}  // namespace

void WriteSubmaps(const std::string& path, const std::vector<SubmapFrameView>& frames) {
  SectionWriter writer(path, kKind);
  for (const SubmapFrameView& frame : frames) {
    StateArchive head;
    std::int64_t number = frame.frame;
    AnchorGraph graph = frame.graph;
    head(&number, &graph.poses, &graph.odometry, &graph.loops);
    writer.Write(kFrame, head.written());
    WriteTrimmed(frame.trimmed, &writer);
    for (std::size_t i = 0; i < frame.submaps.size(); ++i) {
      StateArchive archive;
      std::int64_t piece = frame.pieces[i];
      Submap submap = *frame.submaps[i];
      archive(&piece, &submap);
      writer.Write(kSubmap, archive.written());
    }
  }
  writer.Commit();
}

std::vector<SubmapFrame> ReadSubmaps(const std::string& path) { return SubmapReader(path).Read(); }

}  // namespace lamina
