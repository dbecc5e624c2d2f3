// The three ways in which things go wrong, as types.
//
//   InputError   a file or stream holds something unusable; the message names file, place and rule.
//   OptionError  an option has a value outside of its rule; the message gives name, value and rule.
//   OutputError  something could not be written (permission, full disk); the message names the
//   path.
//
// Programmer errors throw std::logic_error with the values. Numerical failure is never an
// exception: it is a status in the result.
#pragma once

#include <stdexcept>

namespace lamina {

struct InputError : std::runtime_error {
  using std::runtime_error::runtime_error;
};
// Of a file that is whole, but another program's, or of another version: it must stay as it is.
struct OtherFormatError : InputError {
  using InputError::InputError;
};
struct OptionError : std::runtime_error {
  using std::runtime_error::runtime_error;
};
struct OutputError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace lamina
