// `lamina doctor`: the weak places of a finished run, the most harmful first, with their likely
// causes and what to change, as a text and as one HTML file.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace lamina {

// Adds the subcommand to `app`. When the command line names it, *run becomes the function that does
// the work; it returns 0, whatever it finds, and throws InputError, OptionError or OutputError.
// `run` must outlive the parsing.
void AddDoctorCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
