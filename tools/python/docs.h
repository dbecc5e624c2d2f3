// Descriptions for `help` in Python. They stand in lamina.pyi alone: CMake makes a table of them.
#pragma once

namespace lamina::python {

// Of the module (""), a class, a function, or a member ("Mapping.add"). Throws std::logic_error for
// what lamina.pyi does not have.
const char* Doc(const char* name);

}  // namespace lamina::python
