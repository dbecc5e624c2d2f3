#include "tools/benchmark/machine.h"

#include <fmt/format.h>
#include <sys/utsname.h>

#include <cstdlib>
#include <fstream>
#include <string>
#include <thread>

namespace lamina {
namespace {

std::string Processor() {
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);) {
    const std::size_t colon = line.find(": ");
    if (line.rfind("model name", 0) == 0 && colon != std::string::npos)
      return line.substr(colon + 2);
  }
  return "unknown";
}

}  // namespace

nlohmann::json DescribeMachine() {
  utsname system{};
  uname(&system);
  return {{"processor", Processor()},
          {"cores", std::thread::hardware_concurrency()},
          {"system", fmt::format("{} {} {}", system.sysname, system.release, system.machine)}};
}

double MachineLoad() {
  double load = 0.0;
  return getloadavg(&load, 1) == 1 ? load : 0.0;
}

std::string MachineText(const nlohmann::json& machine) {
  return fmt::format("{}, {} cores, load {:.1f} before and {:.1f} after",
                     machine.value("processor", "?"), machine.value("cores", 0),
                     machine.value("load_before", 0.0), machine.value("load_after", 0.0));
}

}  // namespace lamina
