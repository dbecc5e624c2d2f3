// Programs that others are run by.
#pragma once

#include <string>

namespace lamina {

// Whether a folder of PATH has a program of this name.
bool ProgramInPath(const std::string& name);

// The path of `name` beside the program that runs.
std::string ProgramBeside(const std::string& name);

}  // namespace lamina
