// `lamina localise`: how often a sensor of unknown place is found in a generated map, and how soon.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace lamina {

// Adds the subcommand to `app`. When the command line names it, *run becomes the function that does
// the work; it returns the exit code (1: a wrong claim) and throws OptionError or OutputError.
// `run` must outlive the parsing.
void AddLocaliseCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
