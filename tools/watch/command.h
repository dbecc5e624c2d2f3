// `lamina watch`: maps files as they arrive in a folder.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace lamina {

// Adds the subcommand; *run is set if it is the one that the user has chosen.
void AddWatchCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
