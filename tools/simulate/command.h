// `lamina simulate`: formulations of bundle adjustment compared on virtual scenes with exact truth.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace lamina {

// Adds the subcommand to `app`. When the command line names it, *run becomes the function that does
// the work; it returns the exit code and throws OptionError or OutputError. `run` must outlive the
// parsing.
void AddSimulateCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
