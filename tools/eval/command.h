// `lamina eval`: judge trajectories, against a true one and by the maps that they build.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace lamina {

// Adds the subcommand. If the command line names it, *run becomes what to run: it returns the exit
// code and throws InputError, OptionError or OutputError (core/base/error.h). `run` must outlive
// `app`.
void AddEvalCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
