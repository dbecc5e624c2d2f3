#include "tools/simulate/plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "core/base/error.h"
#include "tools/plot/gnuplot.h"

namespace lamina {
namespace {

constexpr int kPanelWidth = 480, kPanelHeight = 400;

// Told apart by those who cannot tell red from green, too. Markers are hollow shapes of gnuplot.
struct CurveStyle {
  const char* colour;
  int marker;
};
constexpr std::array<CurveStyle, 7> kStyles = {{{"#000000", 6},
                                                {"#e69f00", 4},
                                                {"#0072b2", 8},
                                                {"#56b4e9", 10},
                                                {"#cc79a7", 1},
                                                {"#d55e00", 2},
                                                {"#009e73", 12}}};

// Place of a formulation in the registry: its style is the same in every plot.
std::size_t PlaceOf(const Formulation* formulation) {
  const auto& all = Formulations();
  return static_cast<std::size_t>(std::find(all.begin(), all.end(), formulation) - all.begin());
}

template <typename T, typename Member>
std::vector<T> InOrder(const std::vector<TrialSummary>& summaries, Member member) {
  std::vector<T> list;
  for (const TrialSummary& s : summaries) {
    if (std::find(list.begin(), list.end(), s.*member) == list.end()) list.push_back(s.*member);
  }
  return list;
}

std::string BlockName(SweepKind sweep, const Formulation* formulation) {
  return fmt::format("$sweep{}_{}", static_cast<int>(sweep), PlaceOf(formulation));
}

// Value, error, time of each curve, by ascending value.
std::string DataBlock(const std::vector<TrialSummary>& summaries, SweepKind sweep,
                      const Formulation* formulation) {
  std::vector<const TrialSummary*> curve;
  for (const TrialSummary& s : summaries) {
    if (s.sweep == sweep && s.formulation == formulation) curve.push_back(&s);
  }
  std::sort(curve.begin(), curve.end(),
            [](const TrialSummary* a, const TrialSummary* b) { return a->value < b->value; });
  std::string text = BlockName(sweep, formulation) + " << EOD\n";
  for (const TrialSummary* s : curve) {
    text += fmt::format("{:.9g} {:.9g} {:.9g}\n", s->value, s->trans_error_m, s->ms);
  }
  return text + "EOD\n";
}

// Values that span decades are spread by their logarithms, where zero has no place.
std::string ScaleOfX(const std::vector<TrialSummary>& summaries, SweepKind sweep) {
  double least = 0.0, largest = 0.0;
  bool first = true;
  for (const TrialSummary& s : summaries) {
    if (s.sweep != sweep) continue;
    least = first ? s.value : std::min(least, s.value);
    largest = first ? s.value : std::max(largest, s.value);
    first = false;
  }
  constexpr double kWide = 8.0;
  const bool logarithmic = least > 0.0 && largest >= kWide * least;
  std::string text = logarithmic ? "set logscale x\n" : "unset logscale x\n";
  // A margin beside the curves; a single value would have no range at all.
  const double margin = least == largest ? std::max(1e-3, 0.5 * least) : 0.05 * (largest - least);
  text += logarithmic
              ? fmt::format("set xrange [{:.6g}:{:.6g}]\n", least / 1.2, largest * 1.2)
              : fmt::format("set xrange [{:.6g}:{:.6g}]\n", least - margin, largest + margin);
  return text;
}

std::string Panel(const std::vector<const Formulation*>& formulations, SweepKind sweep,
                  int column) {
  std::string text = "plot ";
  // Curves often coincide: markers shrink from one to the next, so that each can be seen.
  double size = 2.0;
  for (const Formulation* formulation : formulations) {
    const CurveStyle style = kStyles[PlaceOf(formulation) % kStyles.size()];
    text += fmt::format(
        "{}{} using 1:{} with linespoints linewidth 2 pointtype {} pointsize {:.1f} linecolor rgb "
        "'{}' title {}",
        formulation == formulations.front() ? "" : ", ", BlockName(sweep, formulation), column,
        style.marker, size, style.colour, GnuplotQuoted(formulation->name));
    size -= 0.2;
  }
  return text + "\n";
}

}  // namespace

std::string StudyScript(const std::vector<TrialSummary>& summaries,
                        const std::string& output_path) {
  const auto sweeps = InOrder<SweepKind>(summaries, &TrialSummary::sweep);
  const auto formulations = InOrder<const Formulation*>(summaries, &TrialSummary::formulation);
  const int columns = static_cast<int>(sweeps.size());
  std::string script = GnuplotTerminal(output_path, kPanelWidth * columns, 2 * kPanelHeight);
  script += fmt::format("set output {}\nset grid\nset datafile missing 'nan'\n",
                        GnuplotQuoted(output_path));
  for (const SweepKind sweep : sweeps) {
    for (const Formulation* f : formulations) script += DataBlock(summaries, sweep, f);
  }
  // Margins are shares of the picture; the key stands above all panels, drawn with the first.
  // More names in a row than fit above one panel, gnuplot would not take.
  constexpr int kNamesInRow = 2;
  const int key_rows = (static_cast<int>(formulations.size()) + kNamesInRow - 1) / kNamesInRow;
  const double width = kPanelWidth * columns, height = 2 * kPanelHeight;
  script += fmt::format(
      "set multiplot layout 2,{} margins screen {:.4f},{:.4f},{:.4f},{:.4f} spacing screen "
      "{:.4f},{:.4f}\n",
      columns, 100 / width, 1.0 - 20 / width, 60 / height, 1.0 - (20 + 20 * key_rows) / height,
      100 / width, 70 / height);
  script += fmt::format(
      "set key at screen 0.5, screen 0.995 center top horizontal maxcols {} samplen 2\n"
      "set logscale y\nset format y '%g'\n",
      kNamesInRow);
  for (int row = 0; row < 2; ++row) {
    for (const SweepKind sweep : sweeps) {
      if (row > 0 || sweep != sweeps.front()) script += "unset key\n";
      script += ScaleOfX(summaries, sweep);
      script += fmt::format(
          "set xlabel {}\nset ylabel {}\n", GnuplotQuoted(SweepLabel(sweep)),
          row == 0 ? "'translation error (m, RMS, median)'" : "'time of a solve (ms, median)'");
      script += Panel(formulations, sweep, row + 2);
    }
  }
  return script + "unset multiplot\nunset output\n";
}

std::string DrawStudy(const std::vector<TrialSummary>& summaries, const std::string& stem) {
  const auto script = [&](const std::string& output) { return StudyScript(summaries, output); };
  try {
    DrawPicture(script, stem + ".png");
    return stem + ".png";
  } catch (const OutputError&) {
    // Not every gnuplot has been built with cairo.
  }
  DrawPicture(script, stem + ".svg");
  return stem + ".svg";
}

}  // namespace lamina
