#include "tools/python/docs.h"

#include <stdexcept>
#include <string>
#include <string_view>

namespace lamina::python {
namespace {

struct Description {
  std::string_view name;
  const char* text;
};
constexpr Description kDescriptions[] = {
#include <python_docstrings.inc>  // of docstrings.py
};

}  // namespace

const char* Doc(const char* name) {
  for (const Description& description : kDescriptions) {
    if (description.name == name) return description.text;
  }
  throw std::logic_error(std::string("lamina.pyi does not describe ") + name);
}

}  // namespace lamina::python
