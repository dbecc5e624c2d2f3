// Options of any kind from YAML, and as YAML: whatever a function shows to an OptionVisitor.
//
// Defaults live in the option structs alone. A YAML file names what differs; `key=value` pairs come
// after it. Keys are those of the Visit functions: `backend.window.frames` is frames below window
// below backend. An unknown key, a wrong type or a value out of range is an OptionError that names
// file, line, value and rule.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "core/options/options.h"

namespace lamina {

// Shows all options of a command, e.g. [&](OptionVisitor& v) { config.Visit(v); }.
using VisitOptions = std::function<void(OptionVisitor&)>;

// Gives the options the values of the file (none if the path is empty), then of the pairs, each
// checked. Where there is no such file, the path may be the name of a shipped one
// (config/shipped_configs.h). Throws OptionError; InputError if the file cannot be read.
void ReadOptions(const std::string& path, const std::vector<std::string>& key_values,
                 const VisitOptions& visit);

// Every option with its value, as YAML that ReadOptions reads back to the same values.
std::string OptionsToYaml(const VisitOptions& visit);

// All dotted names, in order.
std::vector<std::string> OptionNames(const VisitOptions& visit);

// Why there is no configuration of this name, neither as a file nor shipped.
std::string UnknownConfig(const std::string& path);

}  // namespace lamina
