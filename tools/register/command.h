// `lamina register`: poses of a whole batch of scans by bundle adjustment from initial ones.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace lamina {

// Adds the command to the program's parser; when it is chosen, *run becomes what executes it.
void AddRegisterCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
