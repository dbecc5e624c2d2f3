// `lamina config`: the configurations that come with the program.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace lamina {

// As AddRunCommand (tools/run/command.h).
void AddConfigCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
