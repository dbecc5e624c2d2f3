// What reads and writes JSON, which is compiled once, in json_code.cc, and not in each file that
// looks into a summary. Changes nothing for the code that calls it.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <utility>

namespace lamina {

// What the parser reads from where it is given a string.
using JsonText = decltype(nlohmann::detail::input_adapter(std::declval<const std::string&>()));

}  // namespace lamina

// `EXTERN` is `extern` where they are used and nothing where they are compiled.
#define LAMINA_JSON_CODE(EXTERN)                                                   \
  EXTERN template class nlohmann::detail::serializer<nlohmann::json>;              \
  EXTERN template class nlohmann::detail::lexer<nlohmann::json, lamina::JsonText>; \
  EXTERN template class nlohmann::detail::parser<nlohmann::json, lamina::JsonText>;

LAMINA_JSON_CODE(extern)
