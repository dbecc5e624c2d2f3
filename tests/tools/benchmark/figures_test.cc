#include "tools/benchmark/figures.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/base/error.h"
#include "tests/support/files/io_test_files.h"
#include "tools/benchmark/against.h"

namespace lamina {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::ThrowsMessage;

BenchReport ReportOf(const std::vector<double>& cpu_ms, double bytes_a_leaf) {
  BenchReport report;
  report.program = "lamina 1";
  report.machine = {{"processor", "P"}, {"cores", 2}};
  BenchRow row{"street", 2, 70, 120000.0, {}};
  for (const double ms : cpu_ms) row.Add("cpu_ms", "ms", ms);
  row.Add("bytes_a_leaf", "B", bytes_a_leaf, true);
  report.rows.push_back(row);
  return report;
}

TEST(BenchFigures, QuartilesAreRunsOfTheirs) {
  const Spread spread = SpreadOf({5.0, 1.0, 4.0, 2.0, 3.0});
  EXPECT_EQ(spread.low, 2.0);
  EXPECT_EQ(spread.median, 3.0);
  EXPECT_EQ(spread.high, 4.0);
  EXPECT_EQ(SpreadOf({7.0}).Range(), 0.0);
}

TEST(BenchFigures, WhatIsNoNumberIsNoRun) {
  BenchRow row;
  row.Add("cpu_ms", "ms", std::nan(""));
  EXPECT_EQ(row.Find("cpu_ms"), nullptr);
  row.Add("cpu_ms", "ms", 3.0);
  row.Add("cpu_ms", "ms", 4.0);
  EXPECT_THAT(row.Find("cpu_ms")->runs, ElementsAre(3.0, 4.0));
}

TEST(BenchAgainst, ADifferenceWithinTheSpreadIsNoise) {
  const BenchReport before = ReportOf({10.0, 11.0, 9.0, 12.0, 8.0}, 160.0);
  const BenchReport now = ReportOf({10.5, 11.5, 9.5, 12.5, 8.5}, 160.0);
  EXPECT_EQ(Compare(before.rows[0].figures[0], now.rows[0].figures[0]), ChangeKind::kNoise);
  EXPECT_THAT(AgainstTable(before, now),
              HasSubstr("| street, 2 threads | cpu_ms, ms | 10 | 10.50 | noise |"));
}

TEST(BenchAgainst, ALargerOneIsSaidInPerCent) {
  const BenchReport before = ReportOf({10.0, 10.1, 9.9, 10.2, 9.8}, 160.0);
  const BenchReport now = ReportOf({8.0, 8.1, 7.9, 8.2, 7.8}, 152.0);
  const std::string table = AgainstTable(before, now);
  EXPECT_THAT(table, HasSubstr("| cpu_ms, ms | 10 | 8 | **-20.0 %** |"));
  // Exact: one of them is enough.
  EXPECT_THAT(table, HasSubstr("| bytes_a_leaf, B | 160 | 152 | **-5.0 %** |"));
}

TEST(BenchAgainst, CountsMayDifferALittle) {
  const auto kind = [](double before, double now) {
    return Compare({"n", "", true, {before}}, {"n", "", true, {now}});
  };
  EXPECT_EQ(kind(1e6, 1e6 + 100.0), ChangeKind::kNoise);
  EXPECT_EQ(kind(1e6, 1e6 - 1000.0), ChangeKind::kChanged);
  EXPECT_EQ(kind(0.0, 1.0), ChangeKind::kChanged);
}

TEST(BenchAgainst, TwoRunsDoNotTellNoiseFromChange) {
  const BenchReport before = ReportOf({10.0, 10.1}, 160.0), now = ReportOf({5.0, 5.1}, 160.0);
  EXPECT_EQ(Compare(before.rows[0].figures[0], now.rows[0].figures[0]), ChangeKind::kTooFew);
  EXPECT_EQ(Compare(before.rows[0].figures[1], now.rows[0].figures[1]), ChangeKind::kNone);
}

TEST(BenchAgainst, RowsAndScansThatDifferAreNamed) {
  const BenchReport before = ReportOf({10.0, 10.0, 10.0}, 160.0);
  BenchReport now = before;
  now.rows[0].frames = 20;
  now.rows.push_back(now.rows[0]);
  now.rows[1].name = "hall";
  now.machine["processor"] = "Q";
  EXPECT_THAT(AgainstTable(before, now),
              AllOf(HasSubstr("street, 2 threads: other scans than before (20 frames, were 70)"),
                    HasSubstr("hall, 2 threads: not measured before"),
                    HasSubstr("another machine: Q, was P")));
  EXPECT_THAT(AgainstTable(now, before), HasSubstr("hall, 2 threads: not measured now"));
  now.rows[0].Add("instructions", "million", 90.0, true);
  EXPECT_THAT(AgainstTable(before, now),
              HasSubstr("street, 2 threads: instructions not measured before"));
  EXPECT_THAT(AgainstTable(now, before),
              HasSubstr("street, 2 threads: instructions not measured now"));
}

class BenchFile : public FilesTest {};

TEST_F(BenchFile, AReportComesBackAsItWas) {
  BenchReport report = ReportOf({10.0, 11.0, 9.0}, 160.5);
  report.notes = {"not counted"};
  const BenchReport back = ReadBenchReport(Write("bench.json", ToJson(report).dump()));
  EXPECT_EQ(ToJson(back), ToJson(report));
  EXPECT_THAT(BenchTable(back), HasSubstr("| cpu_ms, ms | 10 (9 to 11) |"));
  EXPECT_THAT(BenchTable(back), HasSubstr("| bytes_a_leaf, B | 160.5 |"));
}

TEST_F(BenchFile, BrokenFilesAreErrorsThatNameThem) {
  const auto read = [&](const std::string& text) {
    return [this, text] { ReadBenchReport(Write("bench.json", text)); };
  };
  EXPECT_THAT([&] { ReadBenchReport(Path("none.json")); },
              ThrowsMessage<InputError>(HasSubstr("none.json")));
  EXPECT_THAT(read("{"), ThrowsMessage<InputError>(HasSubstr("bench.json: is no JSON object")));
  EXPECT_THAT(read("{}"),
              ThrowsMessage<InputError>(HasSubstr("is not what `lamina bench` writes")));
  EXPECT_THAT(read(R"({"bench":1})"), ThrowsMessage<InputError>(HasSubstr("bench.json")));
  nlohmann::json json = ToJson(ReportOf({1.0}, 1.0));
  json["rows"][0]["figures"][0]["runs"] = "many";
  EXPECT_THAT(read(json.dump()), ThrowsMessage<InputError>(HasSubstr("bench.json")));
  json["rows"][0]["figures"][0]["runs"] = nlohmann::json::array();
  EXPECT_THAT(read(json.dump()), ThrowsMessage<InputError>(HasSubstr("cpu_ms has no runs")));
}

}  // namespace
}  // namespace lamina
