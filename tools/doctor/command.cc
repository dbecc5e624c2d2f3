#include "tools/doctor/command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <string>

#include "tools/cli/common.h"
#include "tools/cli/options.h"
#include "tools/doctor/data.h"
#include "tools/http/web_assets.h"
#include "tools/report/page.h"
#include "tools/results/output_folder.h"

namespace lamina {
namespace {

struct DoctorArguments {
  DoctorSource source;
  std::string out;
};

int ExamineRun(const DoctorArguments& arguments) {
  const DoctorFindings findings = Examine(arguments.source);
  const std::string page =
      arguments.out.empty()
          ? (std::filesystem::path(arguments.source.folder) / "doctor.html").string()
          : arguments.out;
  CheckReplacesNoResult("--out", page);
  WriteTextFile(page, ReportPage(FindWebFolders(), "doctor.html", DoctorData(findings)));
  fmt::print("{}", DoctorText(findings, page));
  return 0;
}

}  // namespace

void AddDoctorCommand(CLI::App* app, std::function<int()>* run) {
  auto arguments = std::make_shared<DoctorArguments>();
  DoctorArguments& a = *arguments;
  CLI::App* command = app->add_subcommand(
      "doctor", "The weak places of a finished run, their likely causes and what to change");
  command->footer("Exit code 0 whatever is found; `lamina run` judges by its own (3).");
  command
      ->add_option("--run", a.source.folder,
                   "Folder that `lamina run` wrote to, or of a session of `lamina watch`")
      ->type_name("DIR")
      ->required();
  command
      ->add_option("--scans", a.source.scans,
                   "The recording that the run was made from, to name the files of weak places")
      ->type_name("PATH");
  AddTopicOption(command, &a.source.topic);
  command->add_option("--top", a.source.top, "Places that are told, at most")
      ->check(CLI::Range(std::size_t{1}, std::size_t{100}))
      ->capture_default_str();
  command
      ->add_option("--out", a.out, "The page to write; doctor.html in the run's folder if left out")
      ->type_name("FILE");
  command->callback([arguments, run] { *run = [arguments] { return ExamineRun(*arguments); }; });
}

}  // namespace lamina
