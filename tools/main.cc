// The program `lamina`.
// Exit codes: 0 done, 1 failed with a reason, 2 wrong usage: a command line that cannot be parsed,
// or an option or a value of the configuration outside of its rule (OptionError); 3 a run
// that is done and whose poses are probably wrong (tools/results/verdict/verdict.h); 130 ended by
// Ctrl-C before all was done, in good order.

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>

#include "tools/cli/program_path.h"
#include "tools/commands.h"

namespace {

bool IsLabCommand(const std::string& word) {
  for (const lamina::LabCommand& command : lamina::kLabCommands) {
    if (word == command.name) return true;
  }
  return false;
}

// Becomes lamina-lab, which stands beside this program; returns only where that fails.
int RunLab(char** argv) {
  const std::string lab = lamina::ProgramBeside("lamina-lab");
  execv(lab.c_str(), argv);
  fmt::print(stderr, "lamina: error: {}: {} is in a program of its own, which cannot be run: {}\n",
             argv[1], lab, std::strerror(errno));
  return 1;
}

#ifdef LAMINA_HAS_LAB
constexpr auto kAddCommands = lamina::AddProductCommandsAndLabNames;
#else
constexpr auto kAddCommands = lamina::AddProductCommands;
#endif

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && IsLabCommand(argv[1])) return RunLab(argv);
  return lamina::RunProgram(argc, argv, LAMINA_VERSION, kAddCommands);
}
