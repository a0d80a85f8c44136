#pragma once
#include <functional>
#include <string>

#include "anigen/core/json.h"

namespace anigen::experiment {

/// What the text between '{' and '}' stands for. Throws InputError for what it does not know.
using Meaning = std::function<std::string(const std::string& inside)>;

/// `text` with every `{…}` replaced by its meaning; "{{" is a brace. @throws InputError for a brace without its pair
std::string filled_in(const std::string& text, const Meaning& meaning);

/// The same for every text inside a JSON value; keys stay.
Json filled_in(const Json& value, const Meaning& meaning);

}  // namespace anigen::experiment
