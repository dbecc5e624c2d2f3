// The machine that figures were measured on.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace lamina {

// {"processor", "cores", "system"}
nlohmann::json DescribeMachine();

// Programs that want to run, a mean over the last minute; 0 if the system does not tell.
double MachineLoad();

// "AMD EPYC 7B13, 2 cores, load 0.3 before and 1.2 after"
std::string MachineText(const nlohmann::json& machine);

}  // namespace lamina
