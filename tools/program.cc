#include <fmt/format.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <exception>
#include <new>
#include <string>

#include "core/base/error.h"
#include "core/base/printable_text.h"
#include "tools/cli/common.h"
#include "tools/cli/log_text.h"
#include "tools/cli/words.h"
#include "tools/commands.h"

namespace lamina {
namespace {

int RunCommand(const std::function<int()>& run) {
  try {
    return run();
  } catch (const OptionError& error) {
    fmt::print(stderr, "lamina: error: {}\n", Printable(error.what()));
    return 2;
  } catch (const InterruptedError& error) {
    fmt::print(stderr, "lamina: interrupted: {}\n", Printable(error.what()));
    return 128 + StopSignal();
  } catch (const std::bad_alloc&) {
    fmt::print(stderr, "lamina: error: out of memory\n");
  } catch (const std::exception& error) {
    fmt::print(stderr, "lamina: error: {}\n", Printable(error.what()));
  }
  return 1;
}

}  // namespace

int RunProgram(int argc, char** argv, const char* version,
               void (*add_commands)(CLI::App*, std::function<int()>*)) {
  // A file that grows beyond `ulimit -f` is then an error like a full disk, and not the end.
  std::signal(SIGXFSZ, SIG_IGN);
  // Results go to standard output, everything about the way there to standard error.
  spdlog::set_default_logger(spdlog::stderr_color_mt("lamina"));
  spdlog::set_formatter(LogLines("%H:%M:%S %^%l%$"));

  CLI::App app("Lamina: scans of a LiDAR in, poses and a map out.");
  app.require_subcommand(1);
  app.footer(
      "Exit codes: 0 done, 1 failed with a reason, 2 wrong usage, 3 a run whose poses are probably "
      "wrong. 130: ended by Ctrl-C, in good order.\n"
      "`lamina COMMAND --help` explains a command.");
  std::function<int()> run;
  add_commands(&app, &run);
  app.set_version_flag("--version", std::string("lamina ") + version);
  const std::string wrong = DescribeWrongWord(app, {argv + 1, argv + argc});
  if (!wrong.empty()) {
    fmt::print(stderr, "lamina: error: {}\n", Printable(wrong));
    return 2;
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  return RunCommand(run);
}

}  // namespace lamina
