#include "tools/benchmark/against.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace lamina {
namespace {

constexpr double kNotch = 1.57;
constexpr double kExactShare = 5e-4;
constexpr std::size_t kFewestRuns = 3;

double Notch(const BenchFigure& figure) {
  return kNotch * SpreadOf(figure.runs).Range() /
         std::sqrt(static_cast<double>(figure.runs.size()));
}

std::string Verdict(const BenchFigure& before, const BenchFigure& now) {
  const double old_median = SpreadOf(before.runs).median, median = SpreadOf(now.runs).median;
  switch (Compare(before, now)) {
    case ChangeKind::kNone:
      return "equal";
    case ChangeKind::kNoise:
      return "noise";
    case ChangeKind::kTooFew:
      return "too few runs to tell";
    case ChangeKind::kChanged:
      break;
  }
  if (old_median == 0.0) return "**changed**";
  return fmt::format("**{:+.1f} %**", 100.0 * (median - old_median) / std::abs(old_median));
}

const BenchRow* RowLike(const BenchReport& report, const BenchRow& row) {
  const auto at = std::find_if(report.rows.begin(), report.rows.end(), [&](const BenchRow& r) {
    return r.name == row.name && r.threads == row.threads;
  });
  return at == report.rows.end() ? nullptr : &*at;
}

std::string NameOf(const BenchRow& row) {
  return fmt::format("{}, {} thread{}", row.name, row.threads, row.threads == 1 ? "" : "s");
}

}  // namespace

ChangeKind Compare(const BenchFigure& before, const BenchFigure& now) {
  const double old_median = SpreadOf(before.runs).median, median = SpreadOf(now.runs).median;
  const double change = std::abs(median - old_median);
  if (change == 0.0) return ChangeKind::kNone;
  if (before.exact && now.exact)
    return change > kExactShare * std::abs(old_median) ? ChangeKind::kChanged : ChangeKind::kNoise;
  if (std::min(before.runs.size(), now.runs.size()) < kFewestRuns) return ChangeKind::kTooFew;
  return change > Notch(before) + Notch(now) ? ChangeKind::kChanged : ChangeKind::kNoise;
}

std::string AgainstTable(const BenchReport& before, const BenchReport& now) {
  std::string text = "| case | figure | before | now | change |\n|---|---|---|---|---|\n", notes;
  for (const BenchRow& row : now.rows) {
    const BenchRow* const old_row = RowLike(before, row);
    if (old_row == nullptr) {
      notes += fmt::format("- {}: not measured before\n", NameOf(row));
      continue;
    }
    if (old_row->frames != row.frames || old_row->points_a_frame != row.points_a_frame)
      notes += fmt::format("- {}: other scans than before ({} frames, were {})\n", NameOf(row),
                           row.frames, old_row->frames);
    for (const BenchFigure& figure : row.figures) {
      const BenchFigure* const old_figure = old_row->Find(figure.name);
      if (old_figure == nullptr) {
        notes += fmt::format("- {}: {} not measured before\n", NameOf(row), figure.name);
        continue;
      }
      text += fmt::format("| {} | {}{} | {} | {} | {} |\n", NameOf(row), figure.name,
                          figure.unit.empty() ? "" : ", " + figure.unit,
                          FigureText(SpreadOf(old_figure->runs).median),
                          FigureText(SpreadOf(figure.runs).median), Verdict(*old_figure, figure));
    }
  }
  for (const BenchRow& row : before.rows) {
    const BenchRow* const now_row = RowLike(now, row);
    if (now_row == nullptr) {
      notes += fmt::format("- {}: not measured now\n", NameOf(row));
      continue;
    }
    for (const BenchFigure& figure : row.figures) {
      if (now_row->Find(figure.name) == nullptr)
        notes += fmt::format("- {}: {} not measured now\n", NameOf(row), figure.name);
    }
  }
  const auto processor = [](const BenchReport& r) {
    return r.machine.is_object() ? r.machine.value("processor", "?") : std::string("?");
  };
  if (processor(before) != processor(now))
    notes += fmt::format("- another machine: {}, was {}\n", processor(now), processor(before));
  text +=
      "\nNoise: medians differ by no more than 1.57 (range / sqrt(runs) of before + the same of "
      "now), range: from quartile to quartile; of counts, by no more than 0.05 %. If floor_ms "
      "changed, so did the speed of the "
      "machine: see over_floor.\n";
  return notes.empty() ? text : text + "\n" + notes;
}

}  // namespace lamina
