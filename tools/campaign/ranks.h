// The processes of a campaign: those that `mpirun` has started, or this one alone.
//
// All ranks do the same calls in the same order. MPI is used if the program was built with it and
// started by its launcher; without either, there is one rank, and nothing of MPI is touched. An
// error of MPI itself (a rank that is gone) ends all ranks, as MPI does by default.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace lamina {

class Ranks {
 public:
  // Throws OptionError if a launcher started this process and it was built without MPI.
  Ranks();
  // Ends MPI, which waits for the other ranks.
  ~Ranks();
  Ranks(const Ranks&) = delete;
  Ranks& operator=(const Ranks&) = delete;

  std::size_t rank() const { return rank_; }
  std::size_t size() const { return size_; }

  // Gives these bytes, and returns those of all ranks, in their order.
  std::vector<std::string> Exchange(const std::string& mine) const;

  // The same, but rank 0 alone gets them: the others, nothing.
  std::vector<std::string> Gather(const std::string& mine) const;

  // Ends all ranks at once: for an error that the others do not know of.
  [[noreturn]] void Abort(int code) const;

 private:
  std::size_t rank_ = 0, size_ = 1;
  bool started_ = false;
};

}  // namespace lamina
