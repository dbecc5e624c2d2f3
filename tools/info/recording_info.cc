#include "tools/info/recording_info.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/base/median.h"
#include "core/base/printable_text.h"
#include "io/recording/message_topics.h"
#include "tools/results/posed_scans.h"
#include "tools/results/verdict/rules.h"
#include "tools/run/opening_lines.h"

namespace lamina {
namespace {

// As a word for a shell.
std::string ShellWord(const std::string& text) {
  const auto plain = [](unsigned char c) {
    return std::isalnum(c) != 0 ||
           std::string_view("/._-+,:@%=").find(static_cast<char>(c)) != std::string_view::npos;
  };
  if (!text.empty() && std::all_of(text.begin(), text.end(), plain)) return text;
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? "'\\''" : std::string(1, c);
  return quoted + "'";
}

}  // namespace

ScanRate MeasureRate(const std::vector<StampNs>& stamps) {
  ScanRate rate;
  std::vector<double> steps;
  for (std::size_t i = 1; i < stamps.size(); ++i) {
    const double step_s = SecondsBetween(stamps[i - 1], stamps[i]);
    if (step_s > 0.0) {
      steps.push_back(step_s);
    } else {
      ++rate.back;
    }
  }
  if (stamps.size() > 1) rate.span_s = SecondsBetween(stamps.front(), stamps.back());
  if (steps.empty()) return rate;
  rate.period_s = UpperMedian(&steps);
  for (std::size_t i = 1; i < stamps.size(); ++i) {
    const double step_s = SecondsBetween(stamps[i - 1], stamps[i]);
    if (step_s <= run_rules::kGapPeriods * rate.period_s) continue;
    ++rate.gaps;
    rate.missing += static_cast<std::size_t>(std::min(1e9, std::round(step_s / rate.period_s) - 1));
    if (step_s <= rate.longest_gap_s) continue;
    rate.longest_gap_s = step_s;
    rate.longest_gap_after = i - 1;
  }
  return rate;
}

std::string DescribeRate(std::size_t scans, const ScanRate& rate) {
  if (rate.period_s == 0.0) return fmt::format("{} scans, no rate", scans);
  std::string text =
      fmt::format("{} scans over {:.3f} s, {:.4g} Hz", scans, rate.span_s, 1.0 / rate.period_s);
  if (rate.gaps == 0) text += ", no gap";
  if (rate.gaps > 0) {
    text += fmt::format("; {} {}, {} scans missing, the longest {:.3f} s after scan {}", rate.gaps,
                        rate.gaps == 1 ? "gap" : "gaps", rate.missing, rate.longest_gap_s,
                        rate.longest_gap_after);
  }
  if (rate.back > 0) text += fmt::format("; {} stamps are not after the one before", rate.back);
  return text;
}

std::string DescribeTopics(const MessageContainer& container) {
  std::size_t name_width = 0, type_width = 0;
  for (const MessageTopic& topic : container.topics()) {
    name_width = std::max(name_width, Printable(topic.name).size());
    type_width = std::max(type_width, Printable(topic.type).size());
  }
  std::string text;
  const std::vector<std::size_t> scans = TopicsOfScans(container);
  for (std::size_t t = 0; t < container.topics().size(); ++t) {
    const MessageTopic& topic = container.topics()[t];
    std::string rate;
    const double span_s = SecondsBetween(topic.first_log_ns, topic.last_log_ns);
    if (topic.log_times_known && topic.messages > 1 && span_s > 0.0) {
      rate = fmt::format(", {:.4g} Hz", static_cast<double>(topic.messages - 1) / span_s);
    }
    text += fmt::format("topic   {:<{}}  {:<{}}  {} messages{}{}\n", Printable(topic.name),
                        name_width, Printable(topic.type), type_width, topic.messages, rate,
                        std::count(scans.begin(), scans.end(), t) > 0 ? ", scans" : "");
  }
  return text.empty() ? "topic   none\n" : text;
}

std::string DescribeScans(const ScanSource& source, const LaminaConfig& config,
                          const std::string& path, const std::string& topic) {
  const FrameRange all{0, source.size()};
  const FittingConfig fit = FindFittingConfig(source, all);
  const OpeningLines opening = DescribeOpening(source, all, config, fit, "");
  std::string text;
  for (const std::string& line : opening.lines) text += Printable(line) + "\n";
  text +=
      fmt::format("rate    {}\n", source.recorded_stamps()
                                      ? DescribeRate(source.size(), MeasureRate(ScanStamps(source)))
                                      : fmt::format("{} scans, without stamps", source.size()));
  for (const std::string& doubt : opening.doubts) text += "doubt   " + Printable(doubt) + "\n";
  if (!opening.usable) return text + "map it  not as it is: see the doubts\n";
  text += "map it  lamina run --scans " + Printable(ShellWord(path));
  if (!topic.empty()) text += " --topic " + Printable(ShellWord(topic));
  if (!fit.name.empty()) text += " --config " + fit.name;
  return text + " --out out\n";
}

}  // namespace lamina
