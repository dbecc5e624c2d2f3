// What is wrong with the words of a command line, and what was meant.
#pragma once

#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace lamina {

// Looks for the first word that the program has no use for: an unknown command, an unknown option
// of a command, a value that no option takes. Says which it is and what is likely to be meant;
// empty if there is none. To be asked before the words are parsed: a parser that misses an option
// names that one, and not the misspelt one that stands in its place.
std::string DescribeWrongWord(const CLI::App& app, const std::vector<std::string>& words);

}  // namespace lamina
