#include "tools/cli/words.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <map>

#include "core/options/nearest_name.h"

namespace lamina {
namespace {

bool IsOption(const std::string& word) {
  if (word.size() < 2 || word[0] != '-') return false;
  return word[1] == '-' ? word.size() > 2 : std::isalpha(static_cast<unsigned char>(word[1])) != 0;
}

const CLI::App* FindCommand(const CLI::App& app, const std::string& name) {
  const auto found = app.get_subcommands([&](const CLI::App* c) { return c->get_name() == name; });
  return found.empty() ? nullptr : found.front();
}

// Not hidden ones.
std::vector<std::string> CommandsOf(const CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) {
    if (!command->get_name().empty() && !command->get_group().empty()) {
      names.push_back(command->get_name());
    }
  }
  return names;
}

std::vector<std::string> OptionsOf(const CLI::App& command) {
  std::vector<std::string> names;
  for (const CLI::Option* option : command.get_options()) {
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  }
  return names;
}

// What other programs call our options.
std::string OtherName(const std::string& word, const std::vector<std::string>& ours) {
  static const std::multimap<std::string, std::string> kNames{
      {"--input", "--scans"},       {"--input", "--inbox"},     {"-i", "--scans"},
      {"--data", "--scans"},        {"--dir", "--scans"},       {"--folder", "--scans"},
      {"--recording", "--scans"},   {"--output", "--out"},      {"-o", "--out"},
      {"--gt", "--truth"},          {"--reference", "--truth"}, {"--ground-truth", "--truth"},
      {"--groundtruth", "--truth"}, {"-c", "--config"},         {"--cfg", "--config"},
      {"-j", "--threads"},          {"--range", "--frames"},    {"--poses", "--initial"},
      {"--poses", "--estimate"},    {"-v", "--version"}};
  const auto [begin, end] = kNames.equal_range(word);
  for (auto at = begin; at != end; ++at) {
    if (std::find(ours.begin(), ours.end(), at->second) != ours.end()) return at->second;
  }
  return "";
}

std::string UnknownOption(const CLI::App& command, const std::string& place,
                          const std::string& word) {
  const std::vector<std::string> names = OptionsOf(command);
  std::string meant = OtherName(word, names);
  if (meant.empty() && word.rfind("--", 0) == 0) meant = LikelyName(word, names);
  return fmt::format("{}: unknown option '{}'{} `{} --help` lists all", place, word,
                     meant.empty() ? ";" : "; did you mean '" + meant + "'?", place);
}

// Words behind an option that are its values.
int MostValues(const CLI::Option& option) {
  return option.get_allow_extra_args() || option.get_type_size_max() == 0
             ? option.get_items_expected_max()
             : option.get_type_size_max();
}

std::string UnexpectedValue(const CLI::App& command, const std::string& place,
                            const std::string& word) {
  std::string meant;
  for (const char* name : {"--scans", "--inbox", "--run", "--estimate"}) {
    if (command.get_option_no_throw(name) == nullptr) continue;
    meant = fmt::format("; did you mean {} {}?", name, word);
    break;
  }
  return fmt::format("{}: no option takes '{}'{}", place, word, meant);
}

}  // namespace

std::string DescribeWrongWord(const CLI::App& app, const std::vector<std::string>& words) {
  if (words.empty()) return "";
  const std::string& first = words[0];
  if (IsOption(first)) {
    return app.get_option_no_throw(first) != nullptr ? "" : UnknownOption(app, "lamina", first);
  }
  const CLI::App* const command = FindCommand(app, first);
  if (command == nullptr) {
    const std::vector<std::string> names = CommandsOf(app);
    const std::string meant = LikelyName(first, names);
    return fmt::format("unknown command '{}'{} There are {}", first,
                       meant.empty() ? "." : "; did you mean '" + meant + "'?",
                       fmt::join(names, ", "));
  }
  const std::string place = "lamina " + first;
  // Words that may follow which are no options: values of the last option, and those without one.
  int values = 0, positional = 0;
  for (const CLI::Option* option : command->get_options()) {
    if (option->get_positional()) positional += MostValues(*option);
  }
  for (std::size_t i = 1; i < words.size(); ++i) {
    if (words[i] == "--") return "";
    if (!IsOption(words[i])) {
      if (values-- > 0 || positional-- > 0) continue;
      return UnexpectedValue(*command, place, words[i]);
    }
    const std::size_t equals = std::min(words[i].find('='), words[i].size());
    const CLI::Option* const option = command->get_option_no_throw(words[i].substr(0, equals));
    if (option == nullptr) return UnknownOption(*command, place, words[i].substr(0, equals));
    values = equals < words[i].size() ? 0 : MostValues(*option);
  }
  return "";
}

}  // namespace lamina
