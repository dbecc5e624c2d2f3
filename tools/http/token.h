// The secret that a request must carry to change anything: random, in a file that its owner alone
// may read. Who can read the session's files as the daemon's user may also stop the daemon.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace lamina {

// So many random bytes of the system's generator, as lower-case hexadecimal digits.
std::string RandomHex(std::size_t bytes);

// Writes `token` and a line's end to `path`, mode 0600 from the first moment on, whole or not at
// all. Throws OutputError.
void WriteToken(const std::string& path, const std::string& token);

// Whether both are equal, in a time that depends on `given`'s length alone: how long a refusal
// takes must not tell how much of a guess was right.
bool SameSecret(std::string_view given, std::string_view secret);

}  // namespace lamina
