#include "tools/http/web_assets.h"

#include <filesystem>
#include <system_error>

namespace lamina {
namespace {

namespace fs = std::filesystem;

std::string FolderWith(const char* file, const fs::path& folder) {
  std::error_code error;
  return fs::is_regular_file(folder / file, error) ? folder.lexically_normal().string() : "";
}

}  // namespace

WebFolders FindWebFolders() {
  std::error_code error;
  const fs::path program = fs::read_symlink("/proc/self/exe", error);
  WebFolders folders;
  if (!error) {
    folders.page = FolderWith("index.html", program.parent_path() / ".." / "share/lamina/web");
  }
  if (folders.page.empty()) folders.page = FolderWith("index.html", LAMINA_WEB_SOURCE_DIR);
  folders.three = FolderWith("three.min.js", "/usr/share/javascript/three");
  return folders;
}

}  // namespace lamina
