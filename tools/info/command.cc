#include "tools/info/command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <string>

#include "config/config.h"
#include "core/base/first_readable.h"
#include "core/base/printable_text.h"
#include "io/container/message_container.h"
#include "io/message/lidar_message.h"
#include "io/recording/message_topics.h"
#include "tools/cli/options.h"
#include "tools/info/recording_info.h"

namespace lamina {
namespace {

struct InfoArguments {
  std::string scans;
  ConfigArguments config;
};

// Frame and fields of the first message that can be read.
std::string DescribeMessages(const MessageContainer& container, std::size_t topic) {
  const std::vector<MessagePlace>& places = container.Messages(topic);
  const auto describe = [&](std::size_t i) {
    LidarMessageInfo info;
    ScanFromMessage(container.topics()[topic], container.Read(places[i]), PointTimeUnit::kAuto,
                    "message", &info);
    return fmt::format("frame   {}\nfields  {}\n", Printable(info.frame_id),
                       Printable(info.fields));
  };
  return FirstReadable(0, places.size(), describe).value_or("");
}

int DescribeContainer(const InfoArguments& arguments, LaminaConfig config) {
  const auto container = OpenMessageContainer(arguments.scans, IsWantedTopic);
  fmt::print("path    {}: {}\n{}", Printable(arguments.scans), container->kind(),
             DescribeTopics(*container));
  std::vector<std::size_t> lidar;
  for (const std::size_t t : TopicsOfScans(*container)) {
    const std::string& name = container->topics()[t].name;
    if (config.scans.topic.empty() || config.scans.topic == name) lidar.push_back(t);
  }
  // Says what is missing.
  if (lidar.empty()) OpenScans(arguments.scans, config.scans);
  for (const std::size_t t : lidar) {
    const std::string& topic = container->topics()[t].name;
    config.scans.topic = topic;
    fmt::print("\n{}{}", DescribeMessages(*container, t),
               DescribeScans(*OpenScans(arguments.scans, config.scans), config, arguments.scans,
                             lidar.size() > 1 ? topic : ""));
  }
  return 0;
}

int RunInfo(const InfoArguments& arguments) {
  const LaminaConfig config = LoadConfig(arguments.config.file, arguments.config.set);
  if (HoldsMessages(arguments.scans)) return DescribeContainer(arguments, config);
  fmt::print("path    {}\n{}", Printable(arguments.scans),
             DescribeScans(*OpenScans(arguments.scans, config.scans), config, arguments.scans, ""));
  return 0;
}

}  // namespace

void AddInfoCommand(CLI::App* app, std::function<int()>* run) {
  auto arguments = std::make_shared<InfoArguments>();
  CLI::App* command = app->add_subcommand(
      "info", "What is in a recording: topics, scans, rate, gaps, sensor, and how to map it");
  command->add_option("PATH", arguments->scans, "Recording, as for `lamina run`")->required();
  AddTopicOption(command, &arguments->config);
  AddConfigOptions(command, "; what counts is how scans are read", &arguments->config);
  command->callback([arguments, run] { *run = [arguments] { return RunInfo(*arguments); }; });
}

}  // namespace lamina
