// `lamina campaign`: many recordings of one place, over many processes, as one map.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace lamina {

// See AddRunCommand (tools/run/command.h).
void AddCampaignCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
