#include "tools/compare/results/tables.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "tools/compare/methods.h"

namespace lamina {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

using Value = std::function<double(const CompareCell&)>;

double ApeCm(const CompareCell& c) { return 100.0 * c.errors.ape_rmse_m; }
double RpeCm(const CompareCell& c) { return 100.0 * c.errors.rpe_rmse_m; }

const CompareCell* GoodCell(const CompareColumn& column, const std::string& method) {
  const auto found = column.cells.find(method);
  return found != column.cells.end() && found->second.row.good ? &found->second : nullptr;
}

// Of one column, NaN where the method failed.
std::vector<double> ValuesOf(const CompareTable& table, const CompareColumn& column,
                             const Value& value) {
  std::vector<double> values;
  for (const std::string& method : table.methods) {
    const CompareCell* cell = GoodCell(column, method);
    values.push_back(cell == nullptr ? kNone : value(*cell));
  }
  return values;
}

// Over all columns; NaN if there is one without a value.
std::vector<double> MeansOf(const CompareTable& table, const Value& value) {
  std::vector<double> means(table.methods.size(), 0.0);
  for (const CompareColumn& column : table.columns) {
    const std::vector<double> values = ValuesOf(table, column, value);
    for (std::size_t i = 0; i < means.size(); ++i) {
      means[i] += values[i] / static_cast<double>(table.columns.size());
    }
  }
  return means;
}

// Values with so many decimals, the least bold and the next underlined, as they are printed.
std::vector<std::string> Marked(const std::vector<double>& values, int decimals) {
  std::vector<std::string> texts;
  std::vector<double> order;
  for (const double v : values) {
    texts.push_back(std::isnan(v) ? "-" : fmt::format("{:.{}f}", v, decimals));
    if (!std::isnan(v)) order.push_back(std::stod(texts.back()));
  }
  std::sort(order.begin(), order.end());
  order.erase(std::unique(order.begin(), order.end()), order.end());
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (std::isnan(values[i])) continue;
    const double v = std::stod(texts[i]);
    if (v == order[0]) {
      texts[i] = "**" + texts[i] + "**";
    } else if (order.size() > 1 && v == order[1]) {
      texts[i] = "<u>" + texts[i] + "</u>";
    }
  }
  return texts;
}

class MarkdownRows {
 public:
  MarkdownRows(const CompareTable& table, std::string first) : table_(table) {
    head_ = "| " + std::move(first) + " |";
    for (const std::string& method : table.methods) {
      rows_.push_back("| " + FindMethod(method).title + " |");
    }
  }
  void Add(const std::string& name, const std::vector<std::string>& texts) {
    head_ += " " + name + " |";
    for (std::size_t i = 0; i < rows_.size(); ++i) rows_[i] += " " + texts[i] + " |";
    ++columns_;
  }
  // Two values in a cell.
  void AddPair(const std::string& name, const std::vector<std::string>& a,
               const std::vector<std::string>& b) {
    std::vector<std::string> both;
    for (std::size_t i = 0; i < a.size(); ++i) {
      both.push_back(a[i] == "-" ? "failed" : a[i] + " / " + b[i]);
    }
    Add(name, both);
  }
  std::string Text() const {
    std::string text = head_ + "\n|---|";
    for (int i = 0; i < columns_; ++i) text += "---|";
    text += "\n";
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      text += rows_[i] + "\n";
    }
    return text;
  }

 private:
  const CompareTable& table_;
  std::string head_;
  std::vector<std::string> rows_;
  int columns_ = 0;
};

std::string ErrorTable(const CompareTable& table) {
  MarkdownRows rows(table, "RPE / APE, cm");
  for (const CompareColumn& column : table.columns) {
    rows.AddPair(column.sequence, Marked(ValuesOf(table, column, RpeCm), 2),
                 Marked(ValuesOf(table, column, ApeCm), 2));
  }
  if (table.columns.size() > 1) {
    rows.AddPair("mean", Marked(MeansOf(table, RpeCm), 2), Marked(MeansOf(table, ApeCm), 2));
  }
  std::string text = rows.Text();
  std::string start = "Initial poses, APE in cm:";
  bool any = false;
  for (const CompareColumn& column : table.columns) {
    if (!column.has_initial) continue;
    start += fmt::format("{} {} {:.1f}", any ? "," : "", column.sequence,
                         100.0 * column.initial.ape_rmse_m);
    any = true;
  }
  return any ? text + "\n" + start + ".\n" : text;
}

bool HasStructure(const CompareTable& table) {
  for (const CompareColumn& column : table.columns) {
    for (const auto& [name, cell] : column.cells) {
      if (cell.row.structure) return true;
    }
  }
  return false;
}

std::string CostTable(const CompareTable& table) {
  MarkdownRows rows(table, "mean over the sequences");
  const auto add = [&](const char* name, int decimals, const Value& value) {
    rows.Add(name, Marked(MeansOf(table, value), decimals));
  };
  add("RPE, deg", 3, [](const CompareCell& c) { return c.errors.rpe_rmse_deg; });
  add("time, s", 2, [](const CompareCell& c) { return c.row.cpu_s; });
  add("memory, MB", 0,
      [](const CompareCell& c) { return 1e-6 * static_cast<double>(c.row.peak_rss_bytes); });
  if (HasStructure(table)) {
    add("structural error: mean, mm", 2, [](const CompareCell& c) {
      return c.row.structure ? 1e3 * c.row.structure->mean_m : kNone;
    });
    add("median, mm", 2, [](const CompareCell& c) {
      return c.row.structure ? 1e3 * c.row.structure->median_m : kNone;
    });
    add("90 %, mm", 2, [](const CompareCell& c) {
      return c.row.structure ? 1e3 * c.row.structure->percentile90_m : kNone;
    });
  }
  return rows.Text();
}

std::string Failures(const CompareTable& table) {
  std::string text;
  for (const std::string& method : table.methods) {
    for (const CompareColumn& column : table.columns) {
      const auto found = column.cells.find(method);
      if (found == column.cells.end() || found->second.row.good) continue;
      text += fmt::format("- {} on {}: {}\n", FindMethod(method).title, column.sequence,
                          found->second.row.reason);
    }
  }
  return text.empty() ? "" : "\nFailed:\n\n" + text;
}

std::string CsvField(const std::string& text) {
  std::string field = "\"";
  for (const char c : text) field += c == '"' ? "\"\"" : std::string(1, c == '\n' ? ' ' : c);
  return field + "\"";
}

}  // namespace

TrajectoryErrors CompareAll(const std::vector<SE3>& poses, const std::vector<SE3>& truth) {
  Trajectory a, b;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    a.push_back({static_cast<StampNs>(i), poses[i]});
    b.push_back({static_cast<StampNs>(i), truth.at(i)});
  }
  return CompareTrajectories(a, b, Alignment::kSe3);
}

std::string MarkdownTable(const CompareTable& table) {
  return "# " + table.title + "\n\n" + ErrorTable(table) + "\n" + CostTable(table) +
         Failures(table) +
         "\nErrors are root mean squares, APE after SE(3) alignment. Times are processor "
         "time of one thread, without reading files; a method that builds on another's work is "
         "charged with it.\n";
}

std::string CsvTable(const CompareTable& table) {
  std::string text =
      "sequence,method,group,status,reason,rpe_cm,ape_cm,rpe_deg,time_s,cpu_s,solve_s,rounds,"
      "iterations,planes,peak_rss_bytes,structure_mean_mm,structure_median_mm,structure_p90_mm\n";
  for (const CompareColumn& column : table.columns) {
    for (const std::string& method : table.methods) {
      const auto found = column.cells.find(method);
      if (found == column.cells.end()) continue;
      const CompareCell& c = found->second;
      text += fmt::format("{},{},{},{},{},", column.sequence, method,
                          CsvField(ToString(FindMethod(method).group)),
                          c.row.good ? "good" : "failed", CsvField(c.row.reason));
      if (!c.row.good) {
        text += ",,,,,,,,,,,,\n";
        continue;
      }
      text += fmt::format("{:.4f},{:.4f},{:.5f},{:.3f},{:.3f},{:.4f},{},{},{},{},", RpeCm(c),
                          ApeCm(c), c.errors.rpe_rmse_deg, c.row.wall_s, c.row.cpu_s, c.row.solve_s,
                          c.row.rounds, c.row.iterations, c.row.planes, c.row.peak_rss_bytes);
      text += c.row.structure ? fmt::format("{:.3f},{:.3f},{:.3f}\n", 1e3 * c.row.structure->mean_m,
                                            1e3 * c.row.structure->median_m,
                                            1e3 * c.row.structure->percentile90_m)
                              : ",,\n";
    }
  }
  return text;
}

nlohmann::json JsonTable(const CompareTable& table) {
  nlohmann::json rows = nlohmann::json::array();
  for (const CompareColumn& column : table.columns) {
    for (const std::string& method : table.methods) {
      const auto found = column.cells.find(method);
      if (found == column.cells.end()) continue;
      const CompareCell& c = found->second;
      nlohmann::json row = ToJson(c.row);
      row.erase("poses_qxyzw_txyz");
      row["group"] = ToString(FindMethod(method).group);
      row["source"] = FindMethod(method).source;
      if (c.row.good) {
        row["rpe_cm"] = RpeCm(c);
        row["ape_cm"] = ApeCm(c);
        row["rpe_deg"] = c.errors.rpe_rmse_deg;
      }
      rows.push_back(std::move(row));
    }
  }
  nlohmann::json means = nlohmann::json::object();
  const std::vector<double> rpe = MeansOf(table, RpeCm), ape = MeansOf(table, ApeCm);
  const std::vector<double> time = MeansOf(table, [](const auto& c) { return c.row.cpu_s; });
  for (std::size_t i = 0; i < table.methods.size(); ++i) {
    if (std::isnan(ape[i])) continue;
    means[table.methods[i]] = {{"rpe_cm", rpe[i]}, {"ape_cm", ape[i]}, {"time_s", time[i]}};
  }
  return {{"title", table.title}, {"rows", rows}, {"means", means}};
}

}  // namespace lamina
