// The program `lamina`: parses the command line, runs a subcommand, turns errors into messages.
// Exit codes: 0 done, 1 failed with a reason, 2 wrong usage: a command line that cannot be parsed,
// or an option or a value of the configuration outside of its rule (OptionError); 3 a run
// that is done and whose poses are probably wrong (tools/results/verdict.h); 130 ended by Ctrl-C
// before all was done, in good order.

#include <fmt/format.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <exception>
#include <functional>
#include <new>
#include <string>

#include "core/base/error.h"
#include "core/base/printable_text.h"
#include "tools/calibrate/command.h"
#include "tools/cli/common.h"
#include "tools/cli/config_command.h"
#include "tools/cli/log_text.h"
#include "tools/cli/words.h"
#include "tools/compare/command.h"
#include "tools/doctor/command.h"
#include "tools/eval/command.h"
#include "tools/export/command.h"
#include "tools/plot/command.h"
#include "tools/promises/command.h"
#include "tools/register/command.h"
#include "tools/report/command.h"
#include "tools/run/command.h"
#include "tools/simulate/command.h"
#include "tools/synth/command.h"
#include "tools/watch/command.h"

int main(int argc, char** argv) {
  // Results go to standard output, everything about the way there to standard error.
  spdlog::set_default_logger(spdlog::stderr_color_mt("lamina"));
  spdlog::set_formatter(lamina::LogLines("%H:%M:%S %^%l%$"));

  CLI::App app("Lamina: scans of a LiDAR in, poses and a map out.");
  app.require_subcommand(1);
  app.footer(
      "Exit codes: 0 done, 1 failed with a reason, 2 wrong usage, 3 a run whose poses are probably "
      "wrong. 130: ended by Ctrl-C, in good order.\n"
      "`lamina COMMAND --help` explains a command.");
  std::function<int()> run;
  lamina::AddRunCommand(&app, &run);
  lamina::AddWatchCommand(&app, &run);
  lamina::AddRegisterCommand(&app, &run);
  lamina::AddCalibrateCommand(&app, &run);
  lamina::AddConfigCommand(&app, &run);
  lamina::AddEvalCommand(&app, &run);
  lamina::AddExportCommand(&app, &run);
  lamina::AddPlotCommand(&app, &run);
  lamina::AddReportCommand(&app, &run);
  lamina::AddDoctorCommand(&app, &run);
  lamina::AddSynthCommand(&app, &run);
  lamina::AddSimulateCommand(&app, &run);
  lamina::AddCompareCommand(&app, &run);
  lamina::AddAdverseCommand(&app, &run);
  app.set_version_flag("--version", std::string("lamina ") + LAMINA_VERSION);
  const std::string wrong = lamina::DescribeWrongWord(app, {argv + 1, argv + argc});
  if (!wrong.empty()) {
    fmt::print(stderr, "lamina: error: {}\n", lamina::Printable(wrong));
    return 2;
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  try {
    return run();
  } catch (const lamina::OptionError& error) {
    fmt::print(stderr, "lamina: error: {}\n", lamina::Printable(error.what()));
    return 2;
  } catch (const lamina::InterruptedError& error) {
    fmt::print(stderr, "lamina: interrupted: {}\n", lamina::Printable(error.what()));
    return 128 + lamina::StopSignal();
  } catch (const std::bad_alloc&) {
    fmt::print(stderr, "lamina: error: out of memory\n");
  } catch (const std::exception& error) {
    fmt::print(stderr, "lamina: error: {}\n", lamina::Printable(error.what()));
  }
  return 1;
}
