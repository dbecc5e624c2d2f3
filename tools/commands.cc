#include "tools/commands.h"

#include <CLI/CLI.hpp>
#include <stdexcept>

#include "tools/calibrate/command.h"
#include "tools/campaign/command.h"
#include "tools/cli/config_command.h"
#include "tools/doctor/command.h"
#include "tools/eval/command.h"
#include "tools/export/command.h"
#include "tools/graph/command.h"
#include "tools/info/command.h"
#include "tools/merge/command.h"
#include "tools/plot/command.h"
#include "tools/refine/command.h"
#include "tools/register/command.h"
#include "tools/report/command.h"
#include "tools/run/command.h"
#include "tools/watch/command.h"

namespace lamina {

void AddProductCommands(CLI::App* app, std::function<int()>* run) {
  AddRunCommand(app, run);
  AddWatchCommand(app, run);
  AddInfoCommand(app, run);
  AddRegisterCommand(app, run);
  AddCalibrateCommand(app, run);
  AddConfigCommand(app, run);
  AddEvalCommand(app, run);
  AddExportCommand(app, run);
  AddPlotCommand(app, run);
  AddReportCommand(app, run);
  AddDoctorCommand(app, run);
  AddSolveGraphCommand(app, run);
  AddMergeCommand(app, run);
  AddRefineCommand(app, run);
  AddCampaignCommand(app, run);
}

void AddProductCommandsAndLabNames(CLI::App* app, std::function<int()>* run) {
  AddProductCommands(app, run);
  for (const LabCommand& command : kLabCommands) app->add_subcommand(command.name, command.purpose);
}

const char* PurposeOfLabCommand(const std::string& name) {
  for (const LabCommand& command : kLabCommands) {
    if (name == command.name) return command.purpose;
  }
  throw std::logic_error("the laboratory has no command " + name);
}

}  // namespace lamina
