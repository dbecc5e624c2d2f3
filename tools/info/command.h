// `lamina info`: what is in a recording, and the command that maps it.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace lamina {

// Adds the subcommand to `app`. When the command line names it, *run becomes the function that does
// the work; it returns the exit code and throws InputError or OptionError. `run` must outlive the
// parsing.
void AddInfoCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
