// What the bench is put together from, without a clock: cases, floor, stages, counts, exponents.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/base/error.h"
#include "io/recording/scan_source.h"
#include "tests/support/files/io_test_files.h"
#include "tools/benchmark/cases.h"
#include "tools/benchmark/child.h"
#include "tools/benchmark/counters.h"
#include "tools/benchmark/floor.h"
#include "tools/benchmark/measure.h"
#include "tools/benchmark/scaling.h"

namespace lamina {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::ThrowsMessage;

class BenchParts : public FilesTest {};

TEST(BenchCases, ANameScansAndAConfiguration) {
  const BenchCase with = ParseCase("kitti=/data/a,b/raw,kitti_raw");
  EXPECT_EQ(with.name, "kitti");
  EXPECT_EQ(with.scans, "/data/a,b/raw");
  EXPECT_EQ(with.config, "kitti_raw");
  EXPECT_EQ(ParseCase("a=/data").config, "");
  for (const char* wrong : {"", "kitti", "=/data", "kitti=", "kitti=,x", "../x=/data"})
    EXPECT_THROW(ParseCase(wrong), OptionError) << wrong;
}

TEST_F(BenchParts, AGeneratedRecordingIsKeptWhileItsOptionsAre) {
  BenchCase small{"small", "", "", {}, {"--sensor vlp16 --points 300 --frames 2"}};
  PrepareCase(Path("scans/small"), &small);
  EXPECT_EQ(OpenScans(small.scans, {})->size(), 2U);
  Write("scans/small/mark", "");
  PrepareCase(Path("scans/small"), &small);
  EXPECT_TRUE(std::filesystem::exists(Path("scans/small/mark")));
  small.synth.push_back("--frames 1");
  PrepareCase(Path("scans/small"), &small);
  EXPECT_FALSE(std::filesystem::exists(Path("scans/small/mark")));
  EXPECT_EQ(OpenScans(small.scans, {})->size(), 1U);
}

TEST_F(BenchParts, TheFloorPutsEveryPointIntoOneCluster) {
  // Two voxels in the first scan, one in the second; what is no point is in none.
  const auto bytes = [](const std::vector<ScanPoint>& points) {
    return std::string(reinterpret_cast<const char*>(points.data()),
                       points.size() * sizeof(ScanPoint));
  };
  Write("velodyne/000000.bin", bytes({{0.1F, 0.1F, 0.1F, 0.F},
                                      {0.2F, 0.1F, 0.1F, 0.F},
                                      {-0.1F, 0.1F, 0.1F, 0.F},
                                      {NAN, 0.F, 0.F, 0.F}}));
  Write("velodyne/000001.bin", bytes({{0.1F, 0.1F, 0.1F, 0.F}, {0.2F, 0.1F, 0.1F, 0.F}}));
  const auto source = OpenScans(Path(""), {});
  const Floor floor = MeasureFloor(*source, 2, 0.5);
  EXPECT_EQ(floor.points, 3.0);
  EXPECT_EQ(floor.clusters, 1.5);
  EXPECT_GT(floor.cpu_ms, 0.0);
}

constexpr char kHead[] = "scan,read_ms,prepare_ms,cluster_ms,odometry_ms,map_ms,solve_ms\n";

TEST_F(BenchParts, StagesOfEachScan) {
  const auto scans =
      ReadStageTimes(Write("frames.csv", std::string(kHead) + "0,1,2,3,4,5,6\n1,3,2,3,4,5,8\n"));
  ASSERT_EQ(scans.size(), 2U);
  EXPECT_EQ(MeanStages(scans, 0)[0], 2.0);
  EXPECT_EQ(MeanStages(scans, 1)[5], 8.0);
  EXPECT_THAT([&] { ReadStageTimes(Write("frames.csv", "scan,read_ms\n0,1\n")); },
              ThrowsMessage<InputError>(HasSubstr("prepare_ms")));
  EXPECT_THAT([&] { ReadStageTimes(Write("frames.csv", std::string(kHead) + "0,1,2\n")); },
              ThrowsMessage<InputError>(HasSubstr("frames.csv:2: has no number for cluster_ms")));
}

TEST(BenchCounters, CountsOfPerfAndOfCallgrind) {
  const auto perf = ParsePerfStat(
      "# started on\n\n123456,,instructions:u,900,100.00,,\n789,,cache-misses:u,900,100.00,,\n");
  ASSERT_TRUE(perf);
  EXPECT_EQ(perf->instructions, 123456.0);
  EXPECT_EQ(perf->cache_misses, 789.0);
  EXPECT_FALSE(ParsePerfStat("<not supported>,,instructions:u,0,100.00,,\n"));
  const auto callgrind = ParseCallgrind(
      "version: 1\nevents: Ir Dr Dw I1mr D1mr D1mw ILmr DLmr DLmw \nfn=(1) main\n7 10 2\n"
      "totals: 5000 900 800 70 60 50 4 30 200 \n");
  ASSERT_TRUE(callgrind);
  EXPECT_EQ(callgrind->instructions, 5000.0);
  EXPECT_EQ(callgrind->cache_misses, 234.0);
  EXPECT_FALSE(ParseCallgrind("events: Ir\n"));
}

TEST_F(BenchParts, WhatAChildTookAndHowItEnded) {
  const ChildUsage usage = RunChild(
      {"sh", "-c", "i=0; while [ $i -lt 20000 ]; do i=$((i + 1)); done; echo said; exit 4"},
      Path("log"));
  EXPECT_EQ(usage.code, 4);
  EXPECT_GT(usage.cpu_s, 0.0);
  EXPECT_EQ(Bytes(Path("log")), "said\n");
  EXPECT_EQ(RunChild({"sh", "-c", "kill -9 $$"}, Path("log")).code, -1);
  EXPECT_THROW(RunChild({Path("no_program")}, Path("log")), OutputError);
  EXPECT_THAT(
      [&] {
        RunChildWell({"sh", "-c", "echo no room; exit 1"}, Path("log"));
      },
      ThrowsMessage<OutputError>(HasSubstr("no room")));
  EXPECT_EQ(RunChildWell({"sh", "-c", "exit 3"}, Path("log"), 3).code, 3);
}

std::vector<Eigen::Vector2d> Power(double factor, double exponent) {
  std::vector<Eigen::Vector2d> points;
  for (double x = 1000.0; x < 3e5; x *= 2.0) points.emplace_back(x, factor * std::pow(x, exponent));
  return points;
}

TEST(BenchScaling, TheExponentOfAPowerLaw) {
  EXPECT_NEAR(FitExponent(Power(3e-4, 1.0)), 1.0, 1e-12);
  EXPECT_NEAR(FitExponent(Power(7.0, 1.37)), 1.37, 1e-12);
  EXPECT_NEAR(FitExponent(Power(7.0, 0.0)), 0.0, 1e-12);
  // What has no logarithm is left out.
  std::vector<Eigen::Vector2d> points = Power(7.0, 2.0);
  points.emplace_back(10.0, 0.0);
  points.emplace_back(-1.0, 5.0);
  EXPECT_NEAR(FitExponent(points), 2.0, 1e-12);
  EXPECT_TRUE(std::isnan(FitExponent({{5.0, 1.0}, {5.0, 2.0}})));
  EXPECT_TRUE(std::isnan(FitExponent({})));
}

TEST(BenchScaling, WhatGrowsFasterThanTheQuantityIsSaid) {
  const std::vector<ScalingStudy> studies = {
      {"points a scan", {{"cpu_ms", Power(1.0, 1.3)}, {"cluster", Power(1.0, 0.9)}}},
      {"threads", {{"cpu_ms", Power(1.0, 0.0)}}}};
  const std::string table = ScalingTable(studies);
  EXPECT_THAT(table, HasSubstr("| cpu_ms | **1.30** | 0.00 |"));
  EXPECT_THAT(table, HasSubstr("| cluster | 0.90 | - |"));
  EXPECT_THAT(ScalingScript(studies, "it's.svg"),
              AllOf(HasSubstr("set logscale xy"), HasSubstr("'cpu_ms 1.30'"),
                    HasSubstr("set output 'it''s.svg'")));
  EXPECT_NEAR(ToJson(studies)[0]["curves"][0]["exponent"].get<double>(), 1.3, 1e-12);
}

}  // namespace
}  // namespace lamina
