// Options of the command line that several commands have, and mean alike.
#pragma once

#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace lamina {

struct ConfigArguments {
  std::string file;              // --config
  std::vector<std::string> set;  // --set
};

// --config and --set. `note` follows what is said of the file.
void AddConfigOptions(CLI::App* command, const std::string& note, ConfigArguments* arguments);

// --frames A:B, for ParseFrameRange.
void AddFramesOption(CLI::App* command, std::string* frames);

// --threads, for LimitThreads. `note` follows what is said of it.
void AddThreadsOption(CLI::App* command, const std::string& note, int* threads);

// --progress, for ProgressMode.
void AddProgressOption(CLI::App* command, std::string* progress);

}  // namespace lamina
