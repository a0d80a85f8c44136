#pragma once
#include <CLI/CLI.hpp>
#include <string>

#include "anigen/core/config.h"

namespace anigen {

/// A command line as JSON: {"name", "help", "options": [{"name", "letter", "value", "choices", "group", "help",
/// "range", "default", "required", "repeatable"}], "commands": [the same of its subcommands], "command_required"}.
Json command_listing(const CLI::App& app);

/// Text of --help: usage, purpose, options in groups, examples, for lines of 100 characters.
std::string help_text(const CLI::App& app);

/// Completion of a program's words. @param shell bash, zsh, fish, or json for command_listing()
/// @return "" for another shell
std::string completion(const CLI::App& app, const std::string& shell);

/// Manual page of a program, for man(1).
std::string man_page(const CLI::App& app);

}  // namespace anigen
