// `lamina refine`: the map of a run or of a merge, with more effort than there was time for.
#pragma once

#include <functional>

namespace CLI {
class App;
}  // namespace CLI

namespace lamina {

void AddRefineCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
