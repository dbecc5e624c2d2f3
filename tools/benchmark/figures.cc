#include "tools/benchmark/figures.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "core/base/error.h"
#include "core/base/median.h"
#include "io/file/text_input.h"
#include "tools/results/verdict/process_report.h"

namespace lamina {
namespace {

constexpr int kFormat = 1;

nlohmann::json FigureToJson(const BenchFigure& figure) {
  const Spread spread = SpreadOf(figure.runs);
  return {{"unit", figure.unit},        {"exact", figure.exact},        {"median", spread.median},
          {"low_quartile", spread.low}, {"high_quartile", spread.high}, {"runs", figure.runs}};
}

BenchFigure FigureFromJson(const std::string& name, const nlohmann::json& json) {
  BenchFigure figure{name, json.at("unit").get<std::string>(), json.at("exact").get<bool>(),
                     json.at("runs").get<std::vector<double>>()};
  if (figure.runs.empty()) throw InputError(name + " has no runs");
  return figure;
}

BenchRow RowFromJson(const nlohmann::json& json) {
  BenchRow row{json.at("case").get<std::string>(),
               json.at("threads").get<int>(),
               json.at("frames").get<std::size_t>(),
               json.at("points_a_frame").get<double>(),
               {}};
  for (const nlohmann::json& figure : json.at("figures"))
    row.figures.push_back(FigureFromJson(figure.at("name").get<std::string>(), figure));
  return row;
}

std::string Cell(const BenchFigure* figure) {
  if (figure == nullptr) return " - |";
  const Spread spread = SpreadOf(figure->runs);
  if (figure->exact || figure->runs.size() == 1)
    return fmt::format(" {} |", FigureText(spread.median));
  return fmt::format(" {} ({} to {}) |", FigureText(spread.median), FigureText(spread.low),
                     FigureText(spread.high));
}

}  // namespace

Spread SpreadOf(const std::vector<double>& runs) {
  std::vector<double> values = runs;
  const double low = Quantile(&values, 0.25), high = Quantile(&values, 0.75);
  return {low, Median(runs), high};
}

const BenchFigure* BenchRow::Find(const std::string& figure) const {
  const auto at = std::find_if(figures.begin(), figures.end(),
                               [&](const BenchFigure& f) { return f.name == figure; });
  return at == figures.end() ? nullptr : &*at;
}

void BenchRow::Add(const std::string& figure, const std::string& unit, double value, bool exact) {
  if (!std::isfinite(value)) return;
  auto at = std::find_if(figures.begin(), figures.end(),
                         [&](const BenchFigure& f) { return f.name == figure; });
  if (at == figures.end()) at = figures.insert(at, {figure, unit, exact, {}});
  at->runs.push_back(value);
}

nlohmann::json ToJson(const BenchReport& report) {
  nlohmann::json rows = nlohmann::json::array();
  for (const BenchRow& row : report.rows) {
    nlohmann::json figures = nlohmann::json::array();
    for (const BenchFigure& figure : row.figures) {
      figures.push_back(FigureToJson(figure));
      figures.back()["name"] = figure.name;
    }
    rows.push_back({{"case", row.name},
                    {"threads", row.threads},
                    {"frames", row.frames},
                    {"points_a_frame", NumberOrNull(row.points_a_frame)},
                    {"figures", figures}});
  }
  return {{"bench", kFormat},
          {"program", report.program},
          {"machine", report.machine},
          {"notes", report.notes},
          {"rows", rows}};
}

BenchReport ReadBenchReport(const std::string& path) {
  const nlohmann::json json = nlohmann::json::parse(ReadFile(path), nullptr, false);
  if (!json.is_object()) throw InputError(path + ": is no JSON object");
  if (json.value("bench", nlohmann::json()) != kFormat)
    throw InputError(path + ": is not what `lamina bench` writes (\"bench\": 1)");
  try {
    BenchReport report{json.at("machine"),
                       json.at("program").get<std::string>(),
                       {},
                       json.at("notes").get<std::vector<std::string>>()};
    for (const nlohmann::json& row : json.at("rows")) report.rows.push_back(RowFromJson(row));
    return report;
  } catch (const nlohmann::json::exception& error) {
    throw InputError(fmt::format("{}: {}", path, error.what()));
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: {}", path, error.what()));
  }
}

std::string FigureText(double value) {
  const double size = std::abs(value);
  if (size >= 1000.0 || value == std::round(value)) return fmt::format("{:.0f}", value);
  return fmt::format("{:.{}f}", value, size >= 100.0 ? 1 : size >= 10.0 ? 2 : 3);
}

std::string BenchTable(const BenchReport& report) {
  std::string head = "| |", line = "|---|", points = "| frames, points a frame |";
  std::vector<std::pair<std::string, std::string>> names;  // of figures, with their units
  std::set<std::string> known;
  for (const BenchRow& row : report.rows) {
    head += fmt::format(" {}, {} thread{} |", row.name, row.threads, row.threads == 1 ? "" : "s");
    line += "---|";
    points += fmt::format(" {}, {:.0f} |", row.frames, row.points_a_frame);
    for (const BenchFigure& figure : row.figures) {
      if (known.insert(figure.name).second) names.emplace_back(figure.name, figure.unit);
    }
  }
  std::string text = head + "\n" + line + "\n" + points + "\n";
  for (const auto& [name, unit] : names) {
    text += fmt::format("| {}{} |", name, unit.empty() ? "" : ", " + unit);
    for (const BenchRow& row : report.rows) text += Cell(row.Find(name));
    text += "\n";
  }
  return text;
}

}  // namespace lamina
