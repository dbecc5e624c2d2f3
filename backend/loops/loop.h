// A loop: two submaps of one place, and what registration says of them.
#pragma once

#include <cstddef>
#include <string>

#include "backend/anchors/anchor_graph.h"
#include "backend/submaps/submap_registration.h"
#include "core/geometry/state_archive.h"

namespace lamina {

struct Loop {
  enum class Status {
    kAccepted,
    kWaiting,  // nothing speaks against it, and no other loop agrees yet
    kRefused,
  };
  Status status = Status::kRefused;
  bool solved = false;           // accepted, and part of a solve that kept it
  std::string reason;            // unless accepted
  std::size_t from = 0, to = 0;  // positions of the submaps, the earlier one first
  double score = 0.0;            // of the images; 0 where the predicted pose was the hypothesis
  double way_m = 0.0;            // between them, along edges and the loops accepted before
  SubmapMatch match;             // T_other_query: T_from_to

  void Archive(StateArchive& a);
};
const char* ToString(Loop::Status status);
// What a loop says of the two anchors; submaps are taken as not quite rigid.
AnchorEdge EdgeOf(const Loop& loop);

}  // namespace lamina
