// Where the files of the live page and of three.js lie on this machine.
#pragma once

#include <string>

namespace lamina {

struct WebFolders {
  // index.html, viewer.js, ...: share/lamina/web beside the program's bin folder when installed,
  // else tools/web of the source tree that it was built from. Empty: found nowhere.
  std::string page;
  // Of Debian's libjs-three. Empty: not installed.
  std::string three;
};

WebFolders FindWebFolders();

}  // namespace lamina
