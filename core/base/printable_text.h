// Text that may hold bytes of files or of their names, for people to read.
//
// A file's header or name can hold anything: bytes that move a terminal's cursor, change its title
// or colours, or end a line of a log and begin another. They are shown, but have no effect.
#pragma once

#include <string>
#include <string_view>

namespace lamina {

// Printable characters in valid UTF-8 stay as they are. Each byte of anything else (control
// characters, new lines and tabs among them; U+0080..U+009F, which terminals obey as well; marks
// that reorder a line; invalid UTF-8) becomes \xNN. A backslash stays one, so that what has been
// made printable is not changed by doing so again.
std::string Printable(std::string_view text);

}  // namespace lamina
