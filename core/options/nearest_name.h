// What a misspelt name was meant to be.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace lamina {

// Optimal string alignment: insertions, deletions and substitutions of a character, and neighbours
// that have changed places.
std::size_t EditDistance(const std::string& a, const std::string& b);

// The one of `names` (at least one) that is nearest, the first of several.
const std::string& NearestName(const std::string& name, const std::vector<std::string>& names);

// The same, but empty where none is near: less than half of the name is kept, and none of both
// begins with the other.
std::string LikelyName(const std::string& name, const std::vector<std::string>& names);

}  // namespace lamina
