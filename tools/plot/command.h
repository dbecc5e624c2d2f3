// `lamina plot`: a picture of a run's map and trajectory, seen from above.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace lamina {

// Adds the subcommand to `app`. When the command line names it, *run becomes the function that does
// the work; it returns the exit code and throws InputError, OptionError or OutputError. `run` must
// outlive the parsing.
void AddPlotCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
