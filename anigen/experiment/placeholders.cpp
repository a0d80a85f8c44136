#include "anigen/experiment/placeholders.h"

#include "anigen/core/error.h"

namespace anigen::experiment {

std::string filled_in(const std::string& text, const Meaning& meaning) {
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '{') {
      result += text[i];
    } else if (text.compare(i, 2, "{{") == 0) {
      result += text[i++];
    } else {
      const std::size_t end = text.find('}', i);
      if (end == std::string::npos) throw InputError("", "", "'" + text + "': '{' without '}'; a brace itself is '{{'");
      result += meaning(text.substr(i + 1, end - i - 1));
      i = end;
    }
  }
  return result;
}

Json filled_in(const Json& value, const Meaning& meaning) {
  if (value.is_string()) return filled_in(value.get_ref<const std::string&>(), meaning);
  if (!value.is_structured()) return value;
  Json result = value.is_array() ? Json::array() : Json::object();
  if (value.is_array()) {
    for (const Json& item : value) result.push_back(filled_in(item, meaning));
  } else {
    for (const auto& [key, item] : value.items()) result[key] = filled_in(item, meaning);
  }
  return result;
}

}  // namespace anigen::experiment
