// Where a daemon's log lines go: standard error, and files of bounded size in the session.
#pragma once

#include <spdlog/common.h>

#include <string>

#include "backend/localisation/place_report.h"
#include "config/config.h"

namespace lamina {

spdlog::level::level_enum LogLevel(const LogOptions& options);

// From now on the default logger writes to both. Throws OutputError if the files cannot be made.
void SetUpWatchLog(const LogOptions& options, const std::string& session);

// What came of a look for the place of a piece in the map that it is localised in.
void LogLook(const PlaceReport& report);

}  // namespace lamina
