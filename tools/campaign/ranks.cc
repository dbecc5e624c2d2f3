#include "tools/campaign/ranks.h"

#include <algorithm>
#include <cstdlib>

#include "core/base/error.h"

#ifdef LAMINA_HAS_MPI
// Without the C++ bindings, which MPI has given up.
#define OMPI_SKIP_MPICXX 1
#define MPICH_SKIP_MPICXX 1
#include <mpi.h>
#endif

namespace lamina {

namespace {

// Whether a launcher of MPI (Open MPI, MPICH, Slurm) has started this process.
bool WasLaunched() {
  for (const char* name : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMIX_RANK"}) {
    if (std::getenv(name) != nullptr) return true;
  }
  return false;
}

}  // namespace

#ifdef LAMINA_HAS_MPI

namespace {

// Calls message(begin, count) for bytes in order, with as many at a time as a count of MPI, of 32
// bits, can tell.
template <typename Bytes, typename Message>
void InMessages(Bytes* bytes, const Message& message) {
  constexpr std::size_t kMostBytes = std::size_t{1} << 30;
  for (std::size_t at = 0; at < bytes->size(); at += kMostBytes) {
    message(bytes->data() + at, static_cast<int>(std::min(kMostBytes, bytes->size() - at)));
  }
}

}  // namespace

Ranks::Ranks() {
  if (!WasLaunched()) return;
  int provided = 0, rank = 0, size = 1;
  // Threads compute, one alone calls MPI.
  MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &provided);
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  MPI_Comm_size(MPI_COMM_WORLD, &size);
  rank_ = static_cast<std::size_t>(rank);
  size_ = static_cast<std::size_t>(size);
  started_ = true;
}

Ranks::~Ranks() {
  if (started_) MPI_Finalize();
}

std::vector<std::string> Ranks::Exchange(const std::string& mine) const {
  if (!started_) return {mine};
  std::vector<unsigned long long> lengths(size_);
  const unsigned long long length = mine.size();
  MPI_Allgather(&length, 1, MPI_UNSIGNED_LONG_LONG, lengths.data(), 1, MPI_UNSIGNED_LONG_LONG,
                MPI_COMM_WORLD);
  std::vector<std::string> all(size_);
  for (std::size_t r = 0; r < size_; ++r) {
    all[r] = r == rank_ ? mine : std::string(static_cast<std::size_t>(lengths[r]), '\0');
    InMessages(&all[r], [&](char* begin, int count) {
      MPI_Bcast(begin, count, MPI_BYTE, static_cast<int>(r), MPI_COMM_WORLD);
    });
  }
  return all;
}

std::vector<std::string> Ranks::Gather(const std::string& mine) const {
  if (!started_) return {mine};
  constexpr int kTag = 0;
  unsigned long long length = mine.size();
  if (rank_ > 0) {
    MPI_Send(&length, 1, MPI_UNSIGNED_LONG_LONG, 0, kTag, MPI_COMM_WORLD);
    InMessages(&mine, [](const char* begin, int count) {
      MPI_Send(begin, count, MPI_BYTE, 0, kTag, MPI_COMM_WORLD);
    });
    return {};
  }
  std::vector<std::string> all(size_);
  all[0] = mine;
  for (std::size_t r = 1; r < size_; ++r) {
    const int from = static_cast<int>(r);
    MPI_Recv(&length, 1, MPI_UNSIGNED_LONG_LONG, from, kTag, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
    all[r].resize(static_cast<std::size_t>(length));
    InMessages(&all[r], [&](char* begin, int count) {
      MPI_Recv(begin, count, MPI_BYTE, from, kTag, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
    });
  }
  return all;
}

void Ranks::Abort(int code) const {
  if (started_) MPI_Abort(MPI_COMM_WORLD, code);
  std::exit(code);
}

#else

Ranks::Ranks() {
  // Each process would take itself for the only one.
  if (WasLaunched()) {
    throw OptionError(
        "this program was built without MPI: start it without mpirun, or build it "
        "where MPI is installed (Debian: libopenmpi-dev)");
  }
}
Ranks::~Ranks() = default;
std::vector<std::string> Ranks::Exchange(const std::string& mine) const { return {mine}; }
std::vector<std::string> Ranks::Gather(const std::string& mine) const { return {mine}; }
void Ranks::Abort(int code) const { std::exit(code); }

#endif

}  // namespace lamina
