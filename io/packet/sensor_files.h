// Files in which a sensor describes itself, beside a recording of its packets.
#pragma once

#include <initializer_list>
#include <string>

namespace lamina {

// Of a recording DIR/NAME.pcap: the first of DIR/NAME and one of the endings, or DIR/`name`, that
// is there; of a recording that is a folder, `name` in it counts before DIR/`name`. Empty if none
// is.
std::string FindBeside(const std::string& path, std::initializer_list<const char*> endings,
                       const char* name);

// A few kilobytes. Throws InputError if it has megabytes: it is something else.
std::string ReadSmallFile(const std::string& path);

// Ouster's metadata: NAME.json, NAME_0.json or metadata.json.
std::string FindOusterMetadata(const std::string& path);

}  // namespace lamina
