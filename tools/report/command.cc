#include "tools/report/command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "core/base/error.h"
#include "tools/cli/common.h"
#include "tools/http/web_assets.h"
#include "tools/report/data.h"
#include "tools/report/page.h"
#include "tools/results/output_folder.h"

namespace lamina {
namespace {

struct ReportArguments {
  ReportSource source;
  std::string run, session, out;
};

int WriteReport(const ReportArguments& arguments) {
  if (arguments.run.empty() == arguments.session.empty()) {
    throw OptionError("report: give either --run or --session");
  }
  if (!arguments.source.calib.empty() && arguments.source.truth.empty()) {
    throw OptionError("report: --calib is for the poses of --truth, which is missing");
  }
  CheckReplacesNoResult("--out", arguments.out);
  ReportSource source = arguments.source;
  source.folder = arguments.run.empty() ? arguments.session : arguments.run;
  const std::string page = ReportPage(FindWebFolders(), "report.html", ReadReportData(source));
  WriteTextFile(arguments.out, page);
  fmt::print("report {} ({:.1f} MB)\n", arguments.out, static_cast<double>(page.size()) / 1e6);
  return 0;
}

}  // namespace

void AddReportCommand(CLI::App* app, std::function<int()>* run) {
  auto arguments = std::make_shared<ReportArguments>();
  ReportArguments& a = *arguments;
  CLI::App* command = app->add_subcommand(
      "report", "One HTML file with the map in 3D, the trajectory, errors and times of a run");
  command->add_option("--run", a.run, "Folder that `lamina run` wrote to")->type_name("DIR");
  command->add_option("--session", a.session, "Folder of a session of `lamina watch`")
      ->type_name("DIR");
  command->add_option("--out", a.out, "The file to write, such as report.html")
      ->type_name("FILE")
      ->required();
  command
      ->add_option("--truth", a.source.truth,
                   "True trajectory, TUM or KITTI form, to show errors against. Poses are matched "
                   "by stamp; a file without stamps is matched line by line with all scans")
      ->type_name("FILE");
  command
      ->add_option("--calib", a.source.calib,
                   "calib.txt of KITTI odometry, for a truth that holds poses of the camera")
      ->type_name("FILE");
  command
      ->add_option("--max-surfels", a.source.max_surfels,
                   "A larger map is thinned to so many; a thousand take 33 kB of the file")
      ->check(CLI::Range(std::size_t{1}, std::size_t{20000000}))
      ->capture_default_str();
  command->callback([arguments, run] { *run = [arguments] { return WriteReport(*arguments); }; });
}

}  // namespace lamina
