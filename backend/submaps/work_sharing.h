// Heavy loops shared out over processes that do the same computation on the same data.
//
// All processes run in step. Of a loop each computes the items that are its own, all exchange what
// they found, and each goes on with all results in the order of the items: what comes out does not
// depend on how many processes there are, nor on which was quicker. What is exchanged are the bytes
// of the results (core/geometry/state_archive.h), so that nothing is rounded.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "core/geometry/state_archive.h"

namespace lamina {

struct WorkSharing {
  std::size_t part = 0, parts = 1;
  // Gives the bytes of this process, returns those of all, in the order of `part`. All processes
  // call it as often. Not used by one process alone.
  std::function<std::vector<std::string>(const std::string&)> exchange;
  // The same, but the first process alone gets them: the others, nothing.
  std::function<std::vector<std::string>(const std::string&)> gather;
};

// owner[i]: which process does item i. compute(items) returns the results of these items, in their
// order. Returns those of all.
template <typename Result, typename Compute>
std::vector<Result> ShareOut(const std::vector<std::size_t>& owner, const WorkSharing& sharing,
                             const Compute& compute) {
  std::vector<std::size_t> mine;
  for (std::size_t i = 0; i < owner.size(); ++i) {
    if (sharing.parts <= 1 || owner[i] == sharing.part) mine.push_back(i);
  }
  std::vector<Result> found = compute(mine);
  if (sharing.parts <= 1) return found;
  StateArchive out;
  out(&found);
  const std::vector<std::string> bytes = sharing.exchange(out.written());
  std::vector<std::vector<Result>> of_part(sharing.parts);
  for (std::size_t p = 0; p < sharing.parts; ++p) {
    StateArchive in(bytes.at(p));
    in(&of_part[p]);
  }
  std::vector<Result> all;
  std::vector<std::size_t> next(sharing.parts, 0);
  for (const std::size_t o : owner) all.push_back(std::move(of_part[o].at(next[o]++)));
  return all;
}

}  // namespace lamina
