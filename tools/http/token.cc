#include "tools/http/token.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/random.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <vector>

#include "core/base/error.h"
#include "io/file/disk_room.h"

namespace lamina {

std::string RandomHex(std::size_t bytes) {
  std::vector<unsigned char> random(bytes);
  for (std::size_t have = 0; have < bytes;) {
    const ssize_t got = getrandom(random.data() + have, bytes - have, 0);
    if (got > 0) have += static_cast<std::size_t>(got);
    if (got < 0 && errno != EINTR) {
      throw OutputError(fmt::format("the system has no random numbers: {}", std::strerror(errno)));
    }
  }
  return fmt::format("{:02x}", fmt::join(random, ""));
}

void WriteToken(const std::string& path, const std::string& token) {
  const std::string partial = path + ".partial";
  const std::string line = token + "\n";
  const auto fail = [&](const char* doing) {
    const int reason = errno;
    unlink(partial.c_str());
    ThrowNotWritten(path, doing, reason);
  };
  unlink(partial.c_str());
  const int file =
      open(partial.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (file < 0) fail("cannot be created");
  const bool written = write(file, line.data(), line.size()) == static_cast<ssize_t>(line.size());
  if (!(close(file) == 0 && written)) fail("cannot be written");
  if (std::rename(partial.c_str(), path.c_str()) != 0) fail("cannot be written");
}

bool SameSecret(std::string_view given, std::string_view secret) {
  // An empty secret is none at all: nothing matches it.
  unsigned int difference = secret.empty() || given.size() != secret.size() ? 1U : 0U;
  for (std::size_t i = 0; i < given.size() && !secret.empty(); ++i) {
    difference |= static_cast<unsigned int>(static_cast<unsigned char>(given[i]) ^
                                            static_cast<unsigned char>(secret[i % secret.size()]));
  }
  return difference == 0;
}

}  // namespace lamina
