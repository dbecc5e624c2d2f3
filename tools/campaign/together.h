// Work that all ranks do beside one another, and whose failures all of them learn of: otherwise one
// would end and the others wait for it without end.
#pragma once

#include <exception>
#include <new>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "tools/campaign/ranks.h"
#include "tools/cli/common.h"

namespace lamina {

// Thrown on all ranks alike, so that each may end: on rank 0 with what went wrong, which it says.
// The others end as if nothing were: a launcher ends all when one process fails.
struct EndedTogether {
  std::exception_ptr error;  // null on the others
};

// Throws EndedTogether with what the first rank that failed has to say, in its type.
[[noreturn]] void ThrowTogether(const Ranks& ranks, const std::vector<std::string>& failures);

// Calls work(), which must not exchange anything, on every rank, and waits for all. Throws
// EndedTogether if it threw on any.
template <typename Work>
void Together(const Ranks& ranks, const Work& work) {
  // A letter for the type, and the message.
  std::string failure;
  try {
    work();
  } catch (const InputError& error) {
    failure = std::string("i") + error.what();
  } catch (const OptionError& error) {
    failure = std::string("o") + error.what();
  } catch (const OutputError& error) {
    failure = std::string("w") + error.what();
  } catch (const InterruptedError& error) {
    failure = std::string("s") + error.what();
  } catch (const std::bad_alloc&) {
    failure = "xout of memory";
  } catch (const std::exception& error) {
    failure = std::string("x") + error.what();
  }
  const std::vector<std::string> failures = ranks.Exchange(failure);
  for (const std::string& one : failures) {
    if (!one.empty()) ThrowTogether(ranks, failures);
  }
}

}  // namespace lamina
