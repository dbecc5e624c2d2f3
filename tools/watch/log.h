// Where a daemon's log lines go: standard error, and files of bounded size in the session.
#pragma once

#include <spdlog/common.h>

#include <string>

#include "config/config.h"

namespace lamina {

spdlog::level::level_enum LogLevel(const LogOptions& options);

// From now on the default logger writes to both. Throws OutputError if the files cannot be made.
void SetUpWatchLog(const LogOptions& options, const std::string& session);

}  // namespace lamina
