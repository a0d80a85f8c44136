#include "anigen/core/error.h"
#include "anigen/io/rigs/assimp_scan.h"

namespace anigen::io::assimp_import {
namespace {

constexpr std::size_t kMostNested = 1024;

/// Where a tag ends: the '>' outside quotes; npos when there is none.
std::size_t end_of_tag(std::string_view text, std::size_t from) {
  char quote = 0;
  for (std::size_t i = from; i < text.size(); ++i) {
    const char c = text[i];
    if (quote != 0)
      quote = c == quote ? 0 : quote;
    else if (c == '"' || c == '\'')
      quote = c;
    else if (c == '>')
      return i;
  }
  return std::string_view::npos;
}

}  // namespace

void scan_collada(std::string_view text, const std::string& file) {
  std::size_t depth = 0;
  for (std::size_t at = text.find('<'); at != std::string_view::npos; at = text.find('<', at)) {
    const std::string_view rest = text.substr(at);
    const std::string place = "byte " + std::to_string(at);
    const auto skip_to = [&](std::size_t start, std::string_view end) {
      const std::size_t found = text.find(end, at + start);
      at = found == std::string_view::npos ? text.size() : found + end.size();
    };
    if (rest.substr(0, 4) == "<!--") {
      skip_to(4, "-->");
      continue;
    }
    if (rest.substr(0, 9) == "<![CDATA[") {
      skip_to(9, "]]>");
      continue;
    }
    if (rest.substr(0, 2) == "<?") {
      skip_to(2, "?>");
      continue;
    }
    if (rest.substr(0, 2) == "<!") throw NotSupportedError(file, place, "COLLADA with a DOCTYPE");
    const std::size_t end = end_of_tag(text, at + 1);
    if (end == std::string_view::npos) throw InputError(file, place, "a tag is not closed");
    if (rest.substr(0, 2) == "</") {
      depth -= depth > 0 ? 1 : 0;
    } else if (text[end - 1] != '/') {
      if (++depth > kMostNested)
        throw InputError(file, place, "elements are nested deeper than " + std::to_string(kMostNested));
    }
    if (rest.substr(0, 14) == "<instance_node") throw NotSupportedError(file, place, "COLLADA instance_node");
    at = end + 1;
  }
}

}  // namespace anigen::io::assimp_import
