// Options of the command line that several commands have, and mean alike.
#pragma once

#include <cstddef>
#include <optional>
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

// --topic, which becomes the option scans.topic.
void AddTopicOption(CLI::App* command, ConfigArguments* arguments);
// The same, where the run's own configuration says what else counts.
void AddTopicOption(CLI::App* command, std::optional<std::string>* topic);

// --frames A:B, for ParseFrameRange.
void AddFramesOption(CLI::App* command, std::string* frames);

// --threads, for LimitThreads. `note` follows what is said of it.
void AddThreadsOption(CLI::App* command, const std::string& note, int* threads);

// --progress, for ProgressMode.
void AddProgressOption(CLI::App* command, std::string* progress);

// The place of `name` among `names`. Throws OptionError for another.
std::size_t PlaceOf(const std::string& option, const std::string& name,
                    const std::vector<std::string>& names);

// The enumerator that has the place of its name.
template <typename Enum>
Enum ByName(const std::string& option, const std::string& name,
            const std::vector<std::string>& names) {
  return static_cast<Enum>(PlaceOf(option, name, names));
}

}  // namespace lamina
