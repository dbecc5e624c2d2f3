#include "tools/cli/config_command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <string>

#include "config/config.h"
#include "config/shipped_configs.h"
#include "config/yaml_options.h"
#include "core/base/error.h"
#include "tools/cli/common.h"

namespace lamina {
namespace {

struct ConfigCommandArguments {
  std::string name, out;
};

void ListConfigs() {
  for (const ShippedConfig& config : ShippedConfigs()) {
    fmt::print("{:<16}{}\n", config.name, PurposeOf(config));
  }
  fmt::print(
      "\n--config NAME takes one of them, `lamina config NAME` prints it, and --out FILE writes it "
      "for changes of your own.\n");
}

int ShowConfig(const ConfigCommandArguments& arguments) {
  if (arguments.name.empty()) {
    if (!arguments.out.empty())
      throw OptionError("config: --out needs the NAME of a configuration");
    ListConfigs();
    return 0;
  }
  const ShippedConfig* const config = FindShippedConfig(arguments.name);
  if (config == nullptr) throw OptionError("config: " + UnknownConfig(arguments.name));
  if (arguments.out.empty()) {
    fmt::print("{}", config->text);
    return 0;
  }
  if (std::filesystem::exists(arguments.out)) {
    throw OptionError("config: --out " + arguments.out + ": is there already");
  }
  WriteTextFile(arguments.out, config->text);
  fmt::print("wrote {}\n", arguments.out);
  return 0;
}

}  // namespace

void AddConfigCommand(CLI::App* app, std::function<int()>* run) {
  const auto arguments = std::make_shared<ConfigCommandArguments>();
  CLI::App* command =
      app->add_subcommand("config", "List the configurations that come along, or print one");
  command->add_option("name", arguments->name, "The one to print; all are listed without it")
      ->type_name("NAME");
  command->add_option("--out", arguments->out, "Write it to this new file instead")
      ->type_name("FILE");
  command->callback([arguments, run] { *run = [arguments] { return ShowConfig(*arguments); }; });
}

}  // namespace lamina
