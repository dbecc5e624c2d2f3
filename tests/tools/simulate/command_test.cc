// `lamina simulate` as a person runs it: the program, its files, its messages.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <cstdlib>
#include <map>
#include <set>

#include "tests/support/program/run_helpers.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class SimulateCommandTest : public RunTest {
 protected:
  Outcome Simulate(std::vector<std::string> more, int code = 0,
                   const std::string& out = "out") const {
    std::vector<std::string> arguments{"simulate", "--out", Path(out)};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const Outcome outcome = Lamina(arguments);
    EXPECT_EQ(outcome.code, code) << outcome.err;
    return outcome;
  }

  // trials.csv, row by row, by the names of its columns.
  std::vector<std::map<std::string, std::string>> Rows(const std::string& out = "out") const {
    const std::vector<std::string> lines = Lines(Bytes(Path(out + "/trials.csv")));
    std::vector<std::map<std::string, std::string>> rows;
    for (std::size_t i = 1; i < lines.size(); ++i) {
      std::istringstream names(lines[0]), cells(lines[i] + ",");
      std::map<std::string, std::string> row;
      std::string name, cell;
      while (std::getline(names, name, ',') && std::getline(cells, cell, ',')) row[name] = cell;
      rows.push_back(std::move(row));
    }
    return rows;
  }
};

const std::vector<std::string> kTiny = {"--generator", "balm2", "--poses",  "5", "--planes", "12",
                                        "--points",    "15",    "--trials", "2"};

std::vector<std::string> Tiny(std::vector<std::string> more) {
  more.insert(more.begin(), kTiny.begin(), kTiny.end());
  return more;
}

TEST_F(SimulateCommandTest, ComparesAllFormulations) {
  const Outcome outcome = Simulate(Tiny({"--sweep", "noise", "--values", "0.005,0.01"}));
  EXPECT_EQ(Lines(Bytes(Path("out/trials.csv")))[0].rfind(
                "formulation,sweep,value,trial,seed,rot_error_deg,trans_error_m,cost,cost_gap,"
                "iterations,ms",
                0),
            0U);
  const auto rows = Rows();
  ASSERT_EQ(rows.size(), 7U * 2U * 2U);
  std::set<std::string> formulations;
  for (auto row : rows) {
    const std::string& name = row["formulation"];
    formulations.insert(name);
    EXPECT_EQ(row["sweep"], "noise");
    EXPECT_GE(std::stod(row["cost_gap"]), 0.0) << name;
    EXPECT_GT(std::stod(row["ms"]), 0.0);
    EXPECT_GT(std::stoi(row["iterations"]), 0);
    EXPECT_LT(std::stod(row["trans_error_m"]), 0.1) << name;
    if (name != "condensed" && name != "evm2") continue;
    EXPECT_LT(std::stod(row["cost_gap"]), 1e-8) << name;
    EXPECT_EQ(row["status"], "converged");
    EXPECT_EQ(row["success"], "1");
    EXPECT_LE(std::stod(row["iterations_to_1e-8"]), std::stod(row["iterations"]));
  }
  EXPECT_EQ(formulations.size(), 7U);
  EXPECT_EQ(Summary()["medians"].size(), 14U);
  EXPECT_THAT(Bytes(Path("out/summary.md")), HasSubstr(" condensed |"));
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("success"), HasSubstr("evm2"), HasSubstr("trials.csv")));
  if (std::system("gnuplot --version >/dev/null 2>&1") == 0) {
    EXPECT_EQ(Bytes(Path("out/figure1.png")).substr(1, 3), "PNG");
  }
}

TEST_F(SimulateCommandTest, TimesAloneDependOnTheThreads) {
  const std::vector<std::string> arguments = Tiny(
      {"--formulations", "condensed,huang,eigen_factors", "--sweep", "start", "--values", "3,1"});
  const auto run = [&](const std::string& threads, const std::string& out) {
    std::vector<std::string> all = arguments;
    all.insert(all.end(), {"--threads", threads});
    Simulate(all, 0, out);
    auto rows = Rows(out);
    for (auto& row : rows) row.erase("ms"), row.erase("ms_to_1e-8");
    return rows;
  };
  const auto one = run("1", "one");
  EXPECT_EQ(one.size(), 12U);
  EXPECT_EQ(one, run("3", "three"));
}

TEST_F(SimulateCommandTest, JudgesTheCovariance) {
  const Outcome outcome = Simulate(Tiny({"--nees"}));
  EXPECT_THAT(outcome.out,
              AllOf(HasSubstr("of 2 runs with 24 degrees of freedom"), HasSubstr("95 % interval")));
  const auto lines = Lines(Bytes(Path("out/nees.csv")));
  ASSERT_EQ(lines.size(), 3U);
  EXPECT_EQ(lines[0].rfind("sweep,value,trial,seed,nees,", 0), 0U);
}

TEST_F(SimulateCommandTest, ControlCKeepsFinishedTrials) {
  const pid_t child = Start({"simulate", "--out", Path("out"), "--formulations", "condensed",
                             "--trials", "1000000", "--sweep", "planes", "--values", "20"});
  // Rows reach the disk some at a time.
  const std::string partial = Path("out/trials.csv.partial");
  while (IsRunning(child) &&
         (!std::filesystem::exists(partial) || std::filesystem::file_size(partial) < 4096)) {
    usleep(10000);
  }
  ASSERT_EQ(kill(child, SIGINT), 0);
  const Outcome outcome = WaitFor(child);
  EXPECT_EQ(outcome.code, 130) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("stopped after"));
  EXPECT_GT(Rows().size(), 1U);
  EXPECT_EQ(Summary()["medians"][0]["trials"], Rows().size());
  EXPECT_FALSE(std::filesystem::exists(partial));
}

TEST_F(SimulateCommandTest, OptionsAgainstTheirRules) {
  const struct {
    std::vector<std::string> arguments;
    std::vector<std::string> messages;
  } kCases[] = {
      {{"--formulations", "condensed,evm3"}, {"--formulations", "evm3", "evm2"}},
      {{"--formulations", ""}, {"--formulations", "must be one of"}},
      {{"--formulations", "eigen_factors,eigen_factors"}, {"--formulations", "twice"}},
      {{"--sweep", "colour"}, {"--sweep", "colour", "planes"}},
      {{"--generator", "huge"}, {"--generator", "huge", "balm2"}},
      {{"--sweep", "noise", "--values", "0.1,much"}, {"--values", "'much' is not a number"}},
      {{"--sweep", "noise", "--values", "0.1,nan"}, {"--values", "'nan' is not a number"}},
      {{"--sweep", "noise", "--values", "0.1,0.1"}, {"--values", "twice"}},
      {{"--sweep", "noise", "--values", "0.1,,0.2"}, {"--values", "'' is not a number"}},
      {{"--sweep", "noise", "--values", "-0.1"}, {"sweep noise", "-0.1", "[0, 10]"}},
      {{"--sweep", "planes", "--values", "20.5"}, {"20.5", "whole number"}},
      {{"--sweep", "planes", "--values", "2"}, {"sweep planes", "= 2", "[3, "}},
      {{"--sweep", "start", "--values", "200"}, {"sweep start", "200", "[0, 180]"}},
      {{"--values", "1,2"}, {"--values", "--sweep"}},
      {{"--trials", "0"}, {"--trials", "= 0", "[1, "}},
      {{"--trials", "-2"}, {"--trials", "-2", "[1, "}},
      {{"--seed", "-1"}, {"--seed", "-1", "[0, "}},
      {{"--max-iterations", "0"}, {"--max-iterations", "= 0"}},
      {{"--threads", "-1"}, {"--threads", "-1"}},
      {{"--poses", "1"}, {"--poses = 1", "[2, "}},
      {{"--visibility", "2"}, {"--visibility", "= 2", "[0, 1]"}},
      {{"--nees", "--formulations", "eigen_factors"}, {"--nees", "condensed"}},
      {{"--nees", "--noise-m", "0"}, {"--nees", "above 0"}},
  };
  for (const auto& bad : kCases) {
    std::vector<std::string> arguments{"simulate", "--out", Path("out")};
    arguments.insert(arguments.end(), bad.arguments.begin(), bad.arguments.end());
    const Outcome outcome = Lamina(arguments);
    EXPECT_NE(outcome.code, 0);
    for (const std::string& part : bad.messages) EXPECT_THAT(outcome.err, HasSubstr(part));
  }
  EXPECT_FALSE(std::filesystem::exists(Path("out")));
  EXPECT_THAT(Simulate({"--trials", "many"}, 2).err,
              AllOf(HasSubstr("--trials"), HasSubstr("many")));
  EXPECT_EQ(Lamina({"simulate"}).code, 2);
}

TEST_F(SimulateCommandTest, OutputFolderThatCannotBeMade) {
  Write("file", "not a folder");
  EXPECT_THAT(Simulate({}, 1, "file/out").err,
              AllOf(HasSubstr("error: "), HasSubstr(Path("file/out"))));
  EXPECT_EQ(Bytes(Path("file")), "not a folder");
}

TEST_F(SimulateCommandTest, HelpNamesGeneratorsAndDefaults) {
  const std::string help = Lamina({"simulate", "--help"}).out;
  for (const char* part : {"ferrer", "balm2", "condensed,huang,evm2", "10,20,50,100,200", "0.025",
                           "0.01", "--visibility"}) {
    EXPECT_THAT(help, HasSubstr(part));
  }
}

}  // namespace
}  // namespace lamina
