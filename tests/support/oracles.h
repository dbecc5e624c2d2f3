// Programs of others that tests compare with, which may not be installed.
#pragma once

#include <cstdlib>
#include <string>
#include <vector>

namespace lamina {

// A script of tests/io/oracles with these arguments, each quoted; true if it ended without error.
inline bool RunOracle(const std::string& runner, const std::string& script,
                      const std::vector<std::string>& arguments) {
  std::string command = runner + " '" LAMINA_SOURCE_DIR "/tests/io/oracles/" + script + "'";
  for (const std::string& argument : arguments) command += " '" + argument + "'";
  return std::system(command.c_str()) == 0;
}

// What runs scripts that need npm's packages: those in the node_modules of the folder that
// LAMINA_ORACLES names. Empty if it is unset.
inline std::string NodeWithOracles() {
  const char* oracles = std::getenv("LAMINA_ORACLES");
  if (oracles == nullptr) return "";
  return "NODE_PATH='" + std::string(oracles) + "/node_modules' node";
}

// Debian's Python if it has this module, else empty.
inline std::string PythonWith(const std::string& module) {
  const std::string python = "/usr/bin/python3";
  const std::string command = python + " -c 'import " + module + "' 2> /dev/null";
  return std::system(command.c_str()) == 0 ? python : "";
}

}  // namespace lamina
