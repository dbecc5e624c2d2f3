// `lamina compare`: the paper's Table I, its reconstruction figures and its resolution study.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace lamina {

// Adds the subcommand to `app`; when it is parsed, *run is set to what it does.
void AddCompareCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
