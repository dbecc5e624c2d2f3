// What trials of localisation leave behind.
#pragma once

#include <string>
#include <vector>

#include "tools/localise/trial.h"

namespace lamina {

// Markdown: a row for each case, all its seeds together, and how far the right pose came where it
// was not claimed in time.
std::string LocalisationTable(const std::vector<LocalisationTrial>& trials);

// A line for each window.
std::string WindowsCsv(const std::vector<LocalisationTrial>& trials);

// A line for each pose that a look compared, the likeliest of a look first: what it showed, and how
// far from the truth it is.
std::string LooksCsv(const std::vector<LocalisationTrial>& trials);

// Claims that are not right.
std::size_t WrongClaims(const std::vector<LocalisationTrial>& trials);

}  // namespace lamina
