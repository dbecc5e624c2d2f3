#include "tools/benchmark/cases.h"

#include <fmt/format.h>

#include <filesystem>

#include "core/base/error.h"
#include "io/file/file_writer.h"
#include "io/file/folder_writer.h"
#include "tools/cli/common.h"
#include "tools/synth/command.h"
#include "tools/synth/writer.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// Names the options that a generated recording was made with; written last.
constexpr char kMadeBy[] = "made_by.txt";

}  // namespace

std::vector<BenchCase> GeneratedCases(std::size_t frames) {
  const std::string count = fmt::format("--frames {}", frames);
  return {
      {"hdl64", "", "kitti_raw", {}, {"--sensor hdl64 --scene street --sweep --movers 12", count}},
      {"vlp16", "", "kitti_raw", {}, {"--sensor vlp16 --scene street --sweep --movers 12", count}},
      {"avia", "", "livox_avia", {}, {"--sensor avia --scene hall --profile shake", count}}};
}

BenchCase ParseCase(const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos || equals == 0 || equals + 1 == text.size())
    throw OptionError(fmt::format("--case {}: must be NAME=SCANS,CONFIG", text));
  // Paths may have commas, names of configurations have none.
  const std::size_t comma = text.rfind(',');
  const bool has_config = comma != std::string::npos && comma > equals;
  BenchCase result;
  result.name = text.substr(0, equals);
  result.scans = text.substr(equals + 1, has_config ? comma - equals - 1 : std::string::npos);
  if (has_config) result.config = text.substr(comma + 1);
  for (const char c : result.name) {
    if (std::isalnum(static_cast<unsigned char>(c)) == 0 && c != '_' && c != '-')
      throw OptionError(fmt::format("--case {}: a name has letters, digits, _ and - alone", text));
  }
  if (result.scans.empty())
    throw OptionError(fmt::format("--case {}: must be NAME=SCANS,CONFIG", text));
  return result;
}

void PrepareCase(const std::string& folder, BenchCase* bench_case) {
  if (bench_case->synth.empty()) return;
  bench_case->scans = folder;
  const fs::path made_by = fs::path(folder) / kMadeBy;
  const std::string options = fmt::format("{}\n", fmt::join(bench_case->synth, " "));
  if (HoldsText(made_by, options)) return;
  if (fs::exists(made_by)) fs::remove_all(folder);
  MakeDirectory(fs::path(folder).parent_path().string());
  WriteSequence(ParseSynthOptions(bench_case->synth), folder);
  WriteTextFile(made_by.string(), options);
}

}  // namespace lamina
