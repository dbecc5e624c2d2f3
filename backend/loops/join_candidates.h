// Which loops between the submaps of several pieces (piece_joining.h) say the same of how two parts
// of the map lie, and what speaks against those.
//
// Places that repeat look alike: what is right is said by several submaps of either part, or by one
// that shows a lot, and nothing else is said by nearly as many. Of two poses of one pair of submaps
// that differ by half a turn, as rooms and streets allow it, the clearly better one counts.
//
// Private to backend/loops.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "backend/loops/loop.h"
#include "backend/loops/loop_options.h"
#include "backend/loops/piece_joining.h"
#include "backend/loops/piece_submaps.h"

namespace lamina {

// Loops that say the same of two parts.
struct JoinGroup {
  std::size_t a = 0, b = 0;          // the parts, a before b
  std::size_t lead = 0;              // position among the loops of the one with which all agree
  std::vector<std::size_t> members;  // theirs
  std::size_t size = 0;              // submaps of the part that has fewer of them in it
  std::string refusal;
};

// Of the loops that wait. Refers to its arguments.
class JoinCandidates {
 public:
  JoinCandidates(const PieceSubmaps& submaps, const LoopOptions& options, JoinedPieces* pieces)
      : submaps_(submaps), options_(options), pieces_(*pieces) {}

  std::size_t PartOf(std::size_t submap) const { return pieces_.part[submaps_.piece_of(submap)]; }
  Eigen::Vector3d Middle(std::size_t submap) const { return submaps_.images()[submap].middle(); }
  // The frame of part b in that of part a, as a loop has it.
  SE3 BetweenParts(const Loop& loop, std::size_t a) const;
  bool Agree(const Loop& x, const Loop& y, std::size_t a) const;
  // The largest group of these parts, with what speaks against it; nothing if there is none. Its
  // loops, and those of groups that are none, get that as their reason.
  std::optional<JoinGroup> BestOf(std::size_t a, std::size_t b);

 private:
  std::vector<JoinGroup> GroupsOf(std::size_t a, std::size_t b) const;
  std::size_t SizeOf(const JoinGroup& group) const;
  std::string SingleRefusal(const JoinGroup& group) const;
  // Whether `other` is another pose of the same pair, turned by so much at least.
  bool IsRival(const Loop& other, const Loop& loop, std::size_t a, double least_turn_rad) const;
  // Whether a pair of it fits clearly better at another pose, turned by so much at least.
  bool FitsBetterElsewhere(const JoinGroup& group, double least_turn_rad) const;
  // Whether most of its pairs that fit turned by half a turn as well do so nearly as well: what
  // they agree in is then a shell such as that of a room, which others have, too.
  bool FitsTurnedAsWell(const JoinGroup& group) const;

  const PieceSubmaps& submaps_;
  const LoopOptions& options_;
  JoinedPieces& pieces_;
};

}  // namespace lamina
