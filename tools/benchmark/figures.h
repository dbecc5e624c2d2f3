// Figures of repeated runs: every single one, their median and quartiles; as JSON and as Markdown.
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace lamina {

struct BenchFigure {
  std::string name, unit;
  // The same at every run of the same program on the same input, to some 0.01 %: counts, not times.
  bool exact = false;
  std::vector<double> runs;  // one at least, finite
};

// Quartiles and median of the runs: values of theirs but for the median of an even number.
struct Spread {
  double low = 0.0, median = 0.0, high = 0.0;
  double Range() const { return high - low; }
};
Spread SpreadOf(const std::vector<double>& runs);

// A case at a number of threads.
struct BenchRow {
  std::string name;
  int threads = 1;
  std::size_t frames = 0;
  double points_a_frame = 0.0;
  std::vector<BenchFigure> figures;

  // Null if there is none of this name.
  const BenchFigure* Find(const std::string& figure) const;
  // Adds a run to the figure of this name, which is made if it is not there.
  void Add(const std::string& figure, const std::string& unit, double value, bool exact = false);
};

struct BenchReport {
  nlohmann::json machine;  // tools/benchmark/machine.h
  std::string program;     // version of the program measured
  std::vector<BenchRow> rows;
  std::vector<std::string> notes;  // what was not measured, and why
};

nlohmann::json ToJson(const BenchReport& report);

// What ToJson gave. Throws InputError: no such file, no JSON, none of a bench.
BenchReport ReadBenchReport(const std::string& path);

// A row for each figure, a column for each case and number of threads: "median (quartile to
// quartile)".
std::string BenchTable(const BenchReport& report);

// Four digits that mean something.
std::string FigureText(double value);

}  // namespace lamina
