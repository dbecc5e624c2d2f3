#include "tools/report/page.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <regex>

#include "core/base/error.h"
#include "io/file/text_input.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

std::string ReadWebFile(const WebFolders& web, const std::string& name) {
  const bool of_three = name == "three.min.js" || name == "OrbitControls.js";
  if ((of_three ? web.three : web.page).empty()) {
    throw InputError("the report needs " + name + ", which is not installed" +
                     (of_three ? " (Debian: apt install libjs-three)" : ""));
  }
  if (!of_three) return ReadFile((fs::path(web.page) / name).string());
  const fs::path folder = name == "three.min.js" ? "" : "examples/js/controls";
  return ReadFile((fs::path(web.three) / folder / name).string());
}

void ReplaceAll(const std::string& what, const std::string& with, std::string* text) {
  for (std::size_t at = 0; (at = text->find(what, at)) != std::string::npos; at += with.size()) {
    text->replace(at, what.size(), with);
  }
}

// What would end or hide a script is there in strings and comments alone, where this is the same.
std::string AsScript(std::string text) {
  ReplaceAll("</script", "<\\/script", &text);
  ReplaceAll("<!--", "<\\!--", &text);
  return "<script>\n" + text + "</script>";
}

}  // namespace

std::string Base64(std::string_view bytes) {
  static constexpr char kDigits[] =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t three = 0;
    const std::size_t have = std::min<std::size_t>(3, bytes.size() - i);
    for (std::size_t k = 0; k < 3; ++k) {
      three = (three << 8U) | (k < have ? static_cast<unsigned char>(bytes[i + k]) : 0U);
    }
    for (std::size_t k = 0; k < 4; ++k) {
      text += k <= have ? kDigits[(three >> (18U - 6U * k)) & 63U] : '=';
    }
  }
  return text;
}

std::string Base64Floats(const std::vector<double>& values) {
  const std::vector<float> floats(values.begin(), values.end());
  return Base64({reinterpret_cast<const char*>(floats.data()), floats.size() * sizeof(float)});
}

std::string ReportPage(const WebFolders& web, const std::string& frame_name,
                       const nlohmann::json& data) {
  static const std::regex kPart(
      R"re(<link rel="stylesheet" href="([a-z.]+)">|<script src="([A-Za-z.]+)"></script>)re");
  static const std::string kData = "<!-- data -->";
  const std::string frame = ReadWebFile(web, frame_name);
  std::string page;
  std::size_t done = 0;
  for (std::sregex_iterator part(frame.begin(), frame.end(), kPart), end; part != end; ++part) {
    const auto at = static_cast<std::size_t>(part->position());
    page += frame.substr(done, at - done);
    page += (*part)[1].matched ? "<style>\n" + ReadWebFile(web, (*part)[1]) + "</style>"
                               : AsScript(ReadWebFile(web, (*part)[2]));
    done = at + static_cast<std::size_t>(part->length());
  }
  page += frame.substr(done);
  std::string json = data.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  // Within a script, no text may look like its end.
  ReplaceAll("<", "\\u003c", &json);
  const std::size_t at = page.find(kData);
  if (at == std::string::npos) throw InputError(frame_name + " has no place for the data");
  return page.replace(at, kData.size(),
                      "<script type=\"application/json\" id=\"data\">" + json + "</script>");
}

}  // namespace lamina
