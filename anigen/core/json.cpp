#include "anigen/core/json.h"

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"

namespace anigen {
namespace {

// Looks at what a parser would build, without building it: brackets and commas outside strings.
void check_size(std::string_view text, const std::string& file, const JsonLimits& limits) {
  std::size_t depth = 0, values = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (in_string) {
      if (c == '\\')
        ++i;
      else if (c == '"')
        in_string = false;
      continue;
    }
    const bool opens = c == '{' || c == '[';
    if (c == '"')
      in_string = true;
    else if ((c == '}' || c == ']') && depth > 0)
      --depth;
    if (opens && ++depth > limits.depth) {
      throw InputError(file, "byte " + std::to_string(i),
                       "JSON nested deeper than " + std::to_string(limits.depth) + " levels");
    }
    if ((opens || c == ',') && ++values > limits.values) {
      throw InputError(file, "byte " + std::to_string(i),
                       "more than " + std::to_string(limits.values) + " JSON values");
    }
  }
}

}  // namespace

Json parse_json(std::string_view text, const std::string& file, const JsonLimits& limits) {
  check_size(text, file, limits);
  try {
    return Json::parse(text);
  } catch (const nlohmann::json::parse_error& error) {
    std::string reason = error.what();
    const std::size_t colon = reason.find(": ");
    if (colon != std::string::npos) reason = reason.substr(colon + 2);
    throw InputError(file, "byte " + std::to_string(error.byte), "not valid JSON: " + reason);
  } catch (const nlohmann::json::exception& error) {
    // A number beyond double, such as 1e999, is reported as another kind of exception.
    throw InputError(file, "", std::string("not valid JSON: ") + error.what());
  }
}

std::string escaped_for_pointer(const std::string& key) {
  std::string result;
  for (const char c : key) {
    if (c == '~')
      result += "~0";
    else if (c == '/')
      result += "~1";
    else
      result += c;
  }
  return result;
}

Json read_json(const std::filesystem::path& path, const JsonLimits& limits) {
  return parse_json(read_file(path, std::uintmax_t{1} << 30), path.string(), limits);
}

}  // namespace anigen
