#include <CLI/CLI.hpp>

#include "tools/benchmark/command.h"
#include "tools/commands.h"
#include "tools/compare/command.h"
#include "tools/localise/command.h"
#include "tools/promises/command.h"
#include "tools/simulate/command.h"
#include "tools/synth/command.h"

namespace lamina {

void AddLabCommands(CLI::App* app, std::function<int()>* run) {
  AddSynthCommand(app, run);
  AddSimulateCommand(app, run);
  AddCompareCommand(app, run);
  AddAdverseCommand(app, run);
  AddLocaliseCommand(app, run);
  AddBenchCommand(app, run);
}

}  // namespace lamina
