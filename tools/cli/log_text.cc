#include "tools/cli/log_text.h"

#include <fmt/chrono.h>
#include <spdlog/pattern_formatter.h>

#include <nlohmann/json.hpp>

#include "core/base/printable_text.h"

namespace lamina {
namespace {

std::string MessageOf(const spdlog::details::log_msg& message) {
  return Printable({message.payload.data(), message.payload.size()});
}

class PrintableMessage final : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& message, const std::tm&,
              spdlog::memory_buf_t& line) override {
    const std::string text = MessageOf(message);
    line.append(text.data(), text.data() + text.size());
  }
  std::unique_ptr<spdlog::custom_flag_formatter> clone() const override {
    return std::make_unique<PrintableMessage>();
  }
};

class JsonFormatter final : public spdlog::formatter {
 public:
  void format(const spdlog::details::log_msg& message, spdlog::memory_buf_t& line) override {
    const auto since_epoch = message.time.time_since_epoch();
    const auto ms = std::chrono::duration_cast<std::chrono::milliseconds>(since_epoch).count();
    const nlohmann::ordered_json json = {
        {"time", fmt::format("{:%Y-%m-%dT%H:%M:%S}.{:03}Z",
                             fmt::gmtime(static_cast<std::time_t>(ms / 1000)), ms % 1000)},
        {"level", spdlog::level::to_string_view(message.level).data()},
        {"message", MessageOf(message)}};
    const std::string text = json.dump() + "\n";
    line.append(text.data(), text.data() + text.size());
  }
  std::unique_ptr<spdlog::formatter> clone() const override {
    return std::make_unique<JsonFormatter>();
  }
};

}  // namespace

std::unique_ptr<spdlog::formatter> LogLines(const std::string& head) {
  auto lines = std::make_unique<spdlog::pattern_formatter>();
  lines->add_flag<PrintableMessage>('*').set_pattern(head + " %*");
  return lines;
}

std::unique_ptr<spdlog::formatter> LogJson() { return std::make_unique<JsonFormatter>(); }

}  // namespace lamina
