// `lamina adverse`: tries adverse scenes over many seeds, each against what is promised for it.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace lamina {

// Adds the subcommand to `app`. When the command line names it, *run becomes the function that does
// the work; it returns the exit code (1: a promise was not kept) and throws OptionError, InputError
// or OutputError. `run` must outlive the parsing.
void AddAdverseCommand(CLI::App* app, std::function<int()>* run);

}  // namespace lamina
