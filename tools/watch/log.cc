#include "tools/watch/log.h"

#include <spdlog/sinks/rotating_file_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <filesystem>
#include <memory>

#include "core/base/error.h"
#include "io/file/file_writer.h"
#include "tools/cli/log_text.h"

namespace lamina {

spdlog::level::level_enum LogLevel(const LogOptions& options) {
  switch (options.level) {
    case LogOptions::Level::kDebug:
      return spdlog::level::debug;
    case LogOptions::Level::kInfo:
      return spdlog::level::info;
    case LogOptions::Level::kWarn:
      return spdlog::level::warn;
    case LogOptions::Level::kError:
      break;
  }
  return spdlog::level::err;
}

void SetUpWatchLog(const LogOptions& options, const std::string& session) {
  const auto folder = std::filesystem::path(session) / "log";
  MakeDirectory(folder.string());
  try {
    const auto file = std::make_shared<spdlog::sinks::rotating_file_sink_mt>(
        (folder / "lamina.log").string(), static_cast<std::size_t>(options.rotate_mb * 1048576.0),
        static_cast<std::size_t>(options.kept_files));
    const auto screen = std::make_shared<spdlog::sinks::stderr_color_sink_mt>();
    const auto logger =
        std::make_shared<spdlog::logger>("lamina", spdlog::sinks_init_list{screen, file});
    logger->set_formatter(options.json ? LogJson() : LogLines("%Y-%m-%d %H:%M:%S.%e %^%l%$"));
    logger->set_level(LogLevel(options));
    logger->flush_on(spdlog::level::info);
    spdlog::set_default_logger(logger);
  } catch (const spdlog::spdlog_ex& error) {
    throw OutputError(fmt::format("{}: {}", folder.string(), error.what()));
  }
}

void LogLook(const PlaceReport& report) {
  if (!report.found) {
    if (report.reason.empty()) return;
    spdlog::info("scan {}: piece {} is not found in the map yet: {}", report.scan, report.piece,
                 report.reason);
    return;
  }
  const SE3& T = report.found->T_piece_own;
  spdlog::info(
      "scan {}: found in piece {} of the map: piece {} begins there at {:.3f} {:.3f} {:.3f}, "
      "quaternion {:.6f} {:.6f} {:.6f} {:.6f}",
      report.scan, report.found->piece, report.piece, T.t.x(), T.t.y(), T.t.z(), T.q.x(), T.q.y(),
      T.q.z(), T.q.w());
}

}  // namespace lamina
