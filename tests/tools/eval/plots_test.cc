#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "core/base/error.h"
#include "tools/eval/plots.h"
#include "tools/plot/gnuplot.h"

namespace lamina {
namespace {

using testing::HasSubstr;
using testing::Not;

Plot SmallPlot(const std::string& title) {
  return {title, "x (m)", "y (m)", true, {{title, {{0.0, 1.0}, {2.0, 3.5}}}}};
}

TEST(GnuplotScript, HoldsDataAndLabels) {
  const std::string script = GnuplotScript(SmallPlot("path"), "out.svg");
  EXPECT_THAT(script, HasSubstr("set terminal svg"));
  EXPECT_THAT(script, HasSubstr("set output 'out.svg'"));
  EXPECT_THAT(script, HasSubstr("set xlabel 'x (m)'"));
  EXPECT_THAT(script, HasSubstr("set size ratio -1"));
  EXPECT_THAT(script, HasSubstr("0 1\n2 3.5\nEOD"));
  EXPECT_THAT(GnuplotScript(SmallPlot("path"), "out.png"), HasSubstr("set terminal pngcairo"));
}

TEST(GnuplotScript, NoTextBreaksOutOfItsQuotes) {
  const std::string script = GnuplotScript(SmallPlot("a'b\nsystem('id')"), "it's.svg");
  EXPECT_THAT(script, HasSubstr("'a''b system(''id'')'"));
  EXPECT_THAT(script, HasSubstr("'it''s.svg'"));
  EXPECT_THAT(script, Not(HasSubstr("\nsystem")));
}

TEST(GnuplotScript, NonFinitePointsBreakTheLine) {
  Plot plot = SmallPlot("path");
  plot.series[0].points[0].x() = std::nan("");
  EXPECT_THAT(GnuplotScript(plot, "out.svg"), HasSubstr("EOD\n\n2 3.5\n"));
}

TEST(WritePlot, RefusesOtherEndings) {
  EXPECT_THROW(WritePlot(SmallPlot("path"), "picture.jpg"), OptionError);
}

TEST(WritePlot, SaysThatGnuplotIsMissing) {
  const char* path = std::getenv("PATH");
  const std::string before = path == nullptr ? "" : path;
  setenv("PATH", "/nowhere", 1);
  std::string message;
  try {
    WritePlot(SmallPlot("path"), testing::TempDir() + "picture.svg");
  } catch (const OutputError& error) {
    message = error.what();
  }
  setenv("PATH", before.c_str(), 1);
  EXPECT_THAT(message, HasSubstr("gnuplot-nox"));
}

TEST(WritePlot, SaysThatTheFileCannotBeWritten) {
  if (std::system("gnuplot --version >/dev/null 2>&1") != 0) {
    GTEST_SKIP() << "gnuplot is not installed";
  }
  const std::string folder = testing::TempDir() + "plot_no_such_folder";
  EXPECT_THROW(WritePlot(SmallPlot("path"), folder + "/picture.svg"), OutputError);
}

TEST(WritePlot, SaysThatThereWasNothingToDraw) {
  if (std::system("gnuplot --version >/dev/null 2>&1") != 0) {
    GTEST_SKIP() << "gnuplot is not installed";
  }
  Plot plot = SmallPlot("path");
  plot.series[0].points.clear();
  const std::string path = testing::TempDir() + "plot_of_nothing.svg";
  EXPECT_THROW(WritePlot(plot, path), OutputError);
  EXPECT_FALSE(std::filesystem::exists(path));
  EXPECT_FALSE(std::filesystem::exists(path + ".partial.svg"));
}

TEST(ErrorPlot, ShowsTheErrorOverTheDistance) {
  ComparedTrajectory compared{"a", {}, {}};
  for (int i = 0; i < 3; ++i) {
    const SE3 truth(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.0, 2.0 * i, 0.0));
    compared.truth.push_back({i, truth});
    compared.estimate.push_back({i, Retract(truth, 0.5 * i * Vector6d::Unit(5))});
  }
  const Plot plot = ErrorPlot({compared}, Alignment::kFirst);
  ASSERT_EQ(plot.series.size(), 1U);
  ASSERT_EQ(plot.series[0].points.size(), 3U);
  for (int i = 0; i < 3; ++i) {
    EXPECT_LT(
        (plot.series[0].points[static_cast<size_t>(i)] - Eigen::Vector2d(2.0 * i, 0.5 * i)).norm(),
        1e-12);
  }
}

}  // namespace
}  // namespace lamina
