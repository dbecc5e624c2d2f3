#include "tools/doctor/findings.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "core/base/error.h"
#include "core/base/printable_text.h"
#include "io/recording/scan_source.h"
#include "tools/results/recording_part.h"
#include "tools/results/verdict/rules.h"

namespace lamina {
namespace {

std::optional<RunVerdict> VerdictOn(const RunTable& table) {
  if (const auto verdict = ReadVerdict(table.summary)) return verdict;
  VerdictCounter counter(table.config.frontend.matcher.max_iterations);
  for (const RunScan& scan : table.scans) {
    if (!scan.record.skipped && !scan.has_pose) return std::nullopt;
    ScanRecord record = scan.record;
    if (!std::isfinite(record.inlier_share)) record.matched = 0;
    counter.Add(record);
  }
  return counter.Judge();
}

std::map<StampNs, std::string> ReadFileNames(const DoctorSource& source, const RunTable& table) {
  const std::string& path = source.scans;
  if (path.empty()) return {};
  ScanSourceOptions options = table.config.scans;
  options.topic = source.topic.value_or(options.topic);
  const auto scans = OpenScans(path, options);
  const auto part = ReadRecordingPart(table.folder);
  if (part && part->scans != scans->size()) {
    throw InputError(fmt::format(
        "{} and {} do not belong together: the run is of a recording of {} scans, this one has {}",
        table.folder, path, part->scans, scans->size()));
  }
  std::map<StampNs, std::string> names;
  for (std::size_t i = 0; i < scans->size(); ++i) {
    names.emplace(scans->Stamp(i), std::filesystem::path(scans->Name(i)).filename().string());
  }
  const bool any = std::any_of(table.scans.begin(), table.scans.end(), [&](const RunScan& scan) {
    return scan.has_stamp && names.count(scan.record.stamp_ns) > 0;
  });
  if (any) return names;
  throw InputError(fmt::format(
      "{}: none of its {} scans has the stamp of one of the {} scans of {}; they do not belong "
      "together",
      path, scans->size(), table.scans.size(), table.folder));
}

void AddPlace(const DoctorFindings& findings, std::size_t i, std::string* text) {
  const WeakPlace& place = findings.weak->places()[i];
  const PlaceAdvice& advice = findings.advice[i];
  *text += fmt::format("{:2}. {}: {}\n", i + 1, KindOf(place.symptom).name, advice.where);
  const auto add = [&](const char* what, const std::string& line) {
    if (!line.empty()) *text += fmt::format("    {:<9} {}\n", what, Printable(line));
  };
  add("files", NameFiles(findings, place));
  add("measured", advice.measured);
  add("cause", advice.cause);
  if (!advice.settings.empty()) {
    add("change", fmt::format("--set {}", fmt::join(advice.settings, " --set ")));
  }
  add(advice.settings.empty() ? "change" : "or", advice.record);
  const std::vector<std::size_t> beside = PlacesBeside(findings, i);
  if (!beside.empty()) add("see also", fmt::format("{}", fmt::join(beside, ", ")));
}

}  // namespace

DoctorFindings Examine(const DoctorSource& source) {
  DoctorFindings findings;
  findings.table = std::make_unique<const RunTable>(ReadRunTable(source.folder));
  findings.weak = std::make_unique<const WeakPlaces>(*findings.table);
  findings.verdict = VerdictOn(*findings.table);
  findings.file_names = ReadFileNames(source, *findings.table);
  const std::vector<WeakPlace>& places = findings.weak->places();
  for (std::size_t i = 0; i < std::min(source.top, places.size()); ++i) {
    findings.advice.push_back(Advise(*findings.table, *findings.weak, places[i]));
  }
  return findings;
}

std::vector<std::size_t> PlacesBeside(const DoctorFindings& findings, std::size_t i) {
  constexpr std::size_t kNear = 5;
  const std::vector<WeakPlace>& places = findings.weak->places();
  const WeakPlace& here = places[i];
  std::vector<std::size_t> beside;
  for (std::size_t k = 0; k < findings.advice.size(); ++k) {
    const WeakPlace& other = places[k];
    if (k == i || other.symptom == Symptom::kOverBudget) continue;
    if (other.first <= here.last + kNear && here.first <= other.last + kNear) {
      beside.push_back(k + 1);
    }
  }
  return beside;
}

std::string NameFiles(const DoctorFindings& findings, const WeakPlace& place) {
  const auto name = [&](std::size_t i) -> std::string {
    const RunScan& scan = findings.table->scans[i];
    const auto at = findings.file_names.find(scan.record.stamp_ns);
    return scan.has_stamp && at != findings.file_names.end() ? at->second : "";
  };
  const std::string first = name(place.first), last = name(place.last);
  if (first.empty() || last.empty() || first == last) return first;
  return fmt::format("{} to {}", first, last);
}

std::string DescribeRun(const RunTable& table) {
  const auto count = [&](auto is) {
    return std::count_if(table.scans.begin(), table.scans.end(),
                         [&](const RunScan& scan) { return is(scan.record); });
  };
  std::string text = fmt::format("{} scans", table.scans.size());
  const auto lost = count(run_rules::IsLost), degenerate = count(run_rules::IsDegenerate);
  const auto skipped = count([](const ScanRecord& scan) { return scan.skipped; });
  if (lost > 0) text += fmt::format(", {} lost", lost);
  if (degenerate > 0) text += fmt::format(", {} degenerate", degenerate);
  if (skipped > 0) text += fmt::format(", {} skipped", skipped);
  return text;
}

std::string DoctorText(const DoctorFindings& findings, const std::string& page) {
  const std::vector<WeakPlace>& places = findings.weak->places();
  const std::string verdict = findings.verdict ? ToString(*findings.verdict) : "unknown";
  const std::string run = DescribeRun(*findings.table);
  std::string text;
  for (const std::string& note : findings.table->notes) text += "note: " + Printable(note) + "\n";
  if (places.empty() && (!findings.verdict || findings.verdict->reasons.empty())) {
    return text + fmt::format("nothing found: {}; verdict {}; page {}\n", run, verdict, page);
  }
  text += fmt::format("{}; verdict {}\n", run, Printable(verdict));
  if (places.empty()) {
    text += "no single place stands out: the run is alike from end to end\n";
  } else if (findings.advice.size() < places.size()) {
    text += fmt::format("the {} of {} weak places that harm most:\n", findings.advice.size(),
                        places.size());
  } else {
    text += fmt::format("{} weak {}, most harmful first:\n", places.size(),
                        places.size() == 1 ? "place" : "places");
  }
  for (std::size_t i = 0; i < findings.advice.size(); ++i) AddPlace(findings, i, &text);
  return text + fmt::format("page {}\n", page);
}

}  // namespace lamina
