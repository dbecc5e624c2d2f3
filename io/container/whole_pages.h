// SQLite files whose end is missing. SQLite takes what is behind the end of a file for zeros, so
// that rows come out wrong without a word. Opened through this, such a file ends with its last
// whole page and says so itself: what is not there is an error.
//
// Private to io/container.
#pragma once

#include <cstdint>
#include <string>

namespace lamina {

// Bytes that the file should have by its header; 0 if that does not tell. Throws InputError if it
// cannot be read.
std::uint64_t DeclaredSqliteBytes(const std::string& path);

// The name of the VFS of SQLite's through which to open such files, to be read only. Thread-safe.
const char* WholePagesVfs();

}  // namespace lamina
