// `lamina solve-graph`: the poses of a pose graph in g2o form that its edges agree with.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace lamina {

// See AddPlotCommand (tools/plot/command.h).
void AddSolveGraphCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
