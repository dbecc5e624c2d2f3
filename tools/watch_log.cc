#include "tools/watch_log.h"

#include <fmt/chrono.h>
#include <spdlog/formatter.h>
#include <spdlog/sinks/rotating_file_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "tools/command_common.h"

namespace lamina {
namespace {

// A JSON object a line: time (UTC), level, message. File names may be of any bytes.
class JsonFormatter final : public spdlog::formatter {
 public:
  void format(const spdlog::details::log_msg& message, spdlog::memory_buf_t& line) override {
    const auto since_epoch = message.time.time_since_epoch();
    const auto ms = std::chrono::duration_cast<std::chrono::milliseconds>(since_epoch).count();
    const nlohmann::ordered_json json = {
        {"time", fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03}Z",
                             fmt::gmtime(static_cast<std::time_t>(ms / 1000)), ms % 1000)},
        {"level", spdlog::level::to_string_view(message.level).data()},
        {"message", std::string(message.payload.data(), message.payload.size())}};
    const std::string text =
        json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
    line.append(text.data(), text.data() + text.size());
  }
  std::unique_ptr<spdlog::formatter> clone() const override {
    return std::make_unique<JsonFormatter>();
  }
};

}  // namespace

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
    if (options.json) {
      logger->set_formatter(std::make_unique<JsonFormatter>());
    } else {
      logger->set_pattern("%Y-%m-%d %H:%M:%S.%e %^%l%$ %v");
    }
    logger->set_level(LogLevel(options));
    logger->flush_on(spdlog::level::info);
    spdlog::set_default_logger(logger);
  } catch (const spdlog::spdlog_ex& error) {
    throw OutputError(fmt::format("{}: {}", folder.string(), error.what()));
  }
}

}  // namespace lamina
