// YAML that a user has written: what is wrong with it is said with file and line.
//
// Private to config.
#pragma once

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <string>
#include <vector>

#include "core/base/error.h"

namespace lamina {

// use(root) of the text of the file at `path`. What yaml-cpp throws, of the text or because a node
// is not of the type that was asked for, becomes an OptionError.
template <typename Use>
auto UseYaml(const std::string& path, const std::string& text, const Use& use) {
  try {
    const std::vector<YAML::Node> documents = YAML::LoadAll(text);
    for (std::size_t i = 1; i < documents.size(); ++i) {
      if (documents[i].IsNull()) continue;
      throw OptionError(fmt::format("{}:{}: belongs to another document (---), must be one", path,
                                    documents[i].Mark().line + 1));
    }
    return use(documents.empty() ? YAML::Node() : documents.front());
  } catch (const YAML::Exception& error) {
    throw OptionError(
        fmt::format("{}:{}: not valid YAML: {}", path, error.mark.line + 1, error.msg));
  }
}

}  // namespace lamina
