// The commands of the program: those of the product, which `lamina` runs itself, and those of the
// laboratory (generated recordings, studies), which stand in a program of their own, `lamina-lab`,
// that `lamina` runs for them: what they need to be loaded is no burden on the others.
#pragma once

#include <array>
#include <functional>
#include <string>

namespace CLI {
class App;
}

namespace lamina {

// Adds all of them to the command line; parsing it sets `run`.
void AddProductCommands(CLI::App* app, std::function<int()>* run);
void AddLabCommands(CLI::App* app, std::function<int()>* run);
// The same as the product's, and the names of those of the laboratory, for the list of commands.
void AddProductCommandsAndLabNames(CLI::App* app, std::function<int()>* run);

struct LabCommand {
  const char* name;
  const char* purpose;
};
inline constexpr std::array<LabCommand, 6> kLabCommands = {{
    {"synth", "Write a synthetic recording (layout of KITTI odometry) with exact ground truth"},
    {"simulate", "Compare formulations of bundle adjustment on virtual scenes with exact truth"},
    {"compare", "Pairwise, global and bundle adjustment methods side by side, against the truth"},
    {"adverse", "Map adverse generated scenes over many seeds, each against what is promised"},
    {"localise",
     "Find sensors of unknown place in generated maps, and count how often and how soon"},
    {"bench", "Measure what mapping takes: time by stage, memory, counts, how it grows"},
}};
const char* PurposeOfLabCommand(const std::string& name);

// What main() does, for either program: parses the command line, runs the command, turns errors
// into messages and exit codes.
int RunProgram(int argc, char** argv, const char* version,
               void (*add_commands)(CLI::App*, std::function<int()>*));

}  // namespace lamina
