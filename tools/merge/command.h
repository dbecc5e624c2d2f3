// `lamina merge`: drives of one place, mapped on different days, as one map.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace lamina {

// See AddPlotCommand (tools/plot/command.h).
void AddMergeCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
