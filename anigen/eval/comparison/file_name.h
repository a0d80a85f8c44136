#pragma once
#include <string>

namespace anigen::eval {

/// A file name for an id or a label: one that any system takes, and that no two of them share.
std::string file_name(const std::string& text);

}  // namespace anigen::eval
