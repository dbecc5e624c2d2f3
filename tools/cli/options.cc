#include "tools/cli/options.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <functional>
#include <utility>

#include "core/base/error.h"

namespace lamina {
namespace {

void AddTopicOption(CLI::App* command, std::function<void(const std::string&)> take) {
  command
      ->add_option_function<std::string>(
          "--topic", std::move(take),
          "With a bag or MCAP file: the topic of the scans, if there are several")
      ->type_name("NAME");
}

}  // namespace

void AddConfigOptions(CLI::App* command, const std::string& note, ConfigArguments* arguments) {
  command
      ->add_option("--config", arguments->file,
                   "YAML with the options that differ from the defaults, or the name of a shipped "
                   "one (`lamina config` lists them)" +
                       note)
      ->type_name("FILE");
  command
      ->add_option("--set", arguments->set,
                   "One option by its full name, e.g. backend.window.frames=20; may be repeated, "
                   "comes after --config")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
}

void AddTopicOption(CLI::App* command, ConfigArguments* arguments) {
  AddTopicOption(command, [arguments](const std::string& name) {
    arguments->set.push_back("scans.topic=" + name);
  });
}

void AddTopicOption(CLI::App* command, std::optional<std::string>* topic) {
  AddTopicOption(command, [topic](const std::string& name) { *topic = name; });
}

void AddFramesOption(CLI::App* command, std::string* frames) {
  command
      ->add_option("--frames", *frames,
                   "Part of the recording: A:B takes scans A to B-1, counted from 0; either may be "
                   "left out")
      ->type_name("A:B");
}

void AddThreadsOption(CLI::App* command, const std::string& note, int* threads) {
  command
      ->add_option("--threads", *threads, "Threads at most; 0: as many as there are cores" + note)
      ->capture_default_str();
}

void AddProgressOption(CLI::App* command, std::string* progress) {
  command
      ->add_option("--progress", *progress,
                   "auto: a bar on a terminal, else one log line a second; on: the bar; off")
      ->check(CLI::IsMember({"auto", "on", "off"}))
      ->capture_default_str();
}

std::size_t PlaceOf(const std::string& option, const std::string& name,
                    const std::vector<std::string>& names) {
  const auto found = std::find(names.begin(), names.end(), name);
  if (found != names.end()) return static_cast<std::size_t>(found - names.begin());
  throw OptionError(
      fmt::format("{} = '{}': must be one of {}", option, name, fmt::join(names, ", ")));
}

}  // namespace lamina
