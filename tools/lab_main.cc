// The program `lamina-lab`: the commands of the laboratory, run by `lamina` under its own name.
#include "tools/commands.h"

int main(int argc, char** argv) {
  return lamina::RunProgram(argc, argv, LAMINA_VERSION, lamina::AddLabCommands);
}
