// Pages of `lamina report` and `lamina doctor`: each one HTML file that holds everything it needs.
//
// tools/web/report.html or doctor.html is the frame. Its <link rel="stylesheet" href="F"> and
// <script src="F"> give way to the files themselves, and the data goes where <!-- data --> stands,
// as JSON in which what is large is in base64: the binary forms of tools/watch/live/wire.h, and
// arrays of float32.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "tools/http/web_assets.h"

namespace lamina {

std::string Base64(std::string_view bytes);

// An array of float32, in base64; what is not finite stays so and breaks a chart's line.
std::string Base64Floats(const std::vector<double>& values);

// Throws InputError if a file of the page or of three.js, as far as the frame names it, is not
// there.
std::string ReportPage(const WebFolders& web, const std::string& frame_name,
                       const nlohmann::json& data);

}  // namespace lamina
