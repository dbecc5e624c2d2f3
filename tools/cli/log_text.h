// How lines of the log look. Whatever a message holds, it is shown on one line and has no effect on
// a terminal (core/base/printable_text.h).
#pragma once

#include <spdlog/formatter.h>

#include <memory>
#include <string>

namespace lamina {

// spdlog's `head`, then the message.
std::unique_ptr<spdlog::formatter> LogLines(const std::string& head);

// A JSON object a line: time (UTC), level, message.
std::unique_ptr<spdlog::formatter> LogJson();

}  // namespace lamina
