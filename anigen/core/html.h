#pragma once
#include <string>

namespace anigen {

/// Text as it may stand in HTML, inside attributes too: & < > " become entities.
std::string html_escaped(const std::string& text);

}  // namespace anigen
