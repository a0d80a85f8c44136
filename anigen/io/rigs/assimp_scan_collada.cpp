#include <algorithm>
#include <cmath>
#include <unordered_map>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/io/meshes/number_text.h"
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

/// <asset> lies in the root element; others, of a library's parts, say nothing about the scene.
constexpr std::size_t kDepthOfAxes = 3;

bool is_element(std::string_view tag, std::string_view name) {
  return tag.size() > name.size() + 1 && tag.substr(1, name.size()) == name &&
         std::string_view(" \t\r\n>/").find(tag[name.size() + 1]) != std::string_view::npos;
}

constexpr std::string_view kBlanks = " \t\r\n", kStartsOfNumbers = "+-.0123456789";

bool is_blank(char c) { return kBlanks.find(c) != std::string_view::npos; }

void read_up(std::string_view content, FileFrame& frame) {
  while (!content.empty() && is_blank(content.front())) content.remove_prefix(1);
  const std::string_view word = content.substr(0, 4);
  if (word == "X_UP" || word == "Y_UP" || word == "Z_UP") frame.up = word[0];
}

/// The value of ` name="value"` in a tag; empty without it.
std::string_view attribute(std::string_view tag, std::string_view name) {
  for (std::size_t at = tag.find(name); at != std::string_view::npos; at = tag.find(name, at + 1)) {
    const std::size_t equals = at + name.size();
    if (!is_blank(tag[at - 1]) || tag.size() < equals + 3 || tag[equals] != '=') continue;
    const std::size_t end = tag.find(tag[equals + 1], equals + 2);
    if (end != std::string_view::npos) return tag.substr(equals + 2, end - equals - 2);
  }
  return {};
}

void read_unit(std::string_view tag, FileFrame& frame) {
  double metres = 0.0;
  if (parse_number(attribute(tag, "meter"), metres) && metres > 0.0 && std::isfinite(metres)) frame.metres = metres;
}

/// Collects the scene graph from the tags of nodes, each of which hangs on the node around it and on every node that
/// names it in an instance_node.
class NodeTags {
 public:
  void open(std::string_view id) {
    const std::int64_t node = id.empty() ? next_++ : number(id);
    graph_.nodes.push_back(node);
    graph_.links.emplace_back(node, around());
    open_.push_back(node);
  }
  void close() {
    if (!open_.empty()) open_.pop_back();
  }
  void instance(std::string_view url) {
    if (!url.empty() && url.front() == '#') url.remove_prefix(1);
    graph_.links.emplace_back(number(url), around());
  }
  const SceneGraph& graph() const { return graph_; }

 private:
  std::int64_t around() const { return open_.empty() ? 0 : open_.back(); }
  std::int64_t number(std::string_view id) {
    const auto [there, is_new] = numbers_.try_emplace(id, next_);
    next_ += is_new ? 1 : 0;
    return there->second;
  }

  std::unordered_map<std::string_view, std::int64_t> numbers_;
  std::int64_t next_ = 1;
  std::vector<std::int64_t> open_;
  SceneGraph graph_;
};

}  // namespace

void mend_collada(std::string& text) {
  for (std::size_t at = text.find('>'); at != std::string::npos; at = text.find('>', at + 1)) {
    const std::size_t first = text.find_first_not_of(kBlanks, at + 1);
    if (first == std::string::npos || first == at + 1 || kStartsOfNumbers.find(text[first]) == std::string_view::npos)
      continue;
    const auto begin = text.begin() + static_cast<std::ptrdiff_t>(at + 1);
    const auto end = text.begin() + static_cast<std::ptrdiff_t>(std::min(text.find('<', first), text.size()));
    std::rotate(begin, text.begin() + static_cast<std::ptrdiff_t>(first), end);
  }
}

FileFrame scan_collada(std::string_view text, const std::string& file, std::size_t max_nodes) {
  refuse_utf16(text, file);
  FileFrame frame;
  NodeTags nodes;
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
    const bool is_empty = text[end - 1] == '/';
    if (rest.substr(0, 2) == "</") {
      depth -= depth > 0 ? 1 : 0;
      if (is_element(rest.substr(1), "node")) nodes.close();
    } else if (!is_empty) {
      if (++depth > kMostNested)
        throw InputError(file, place, "elements are nested deeper than " + std::to_string(kMostNested));
    }
    const std::string_view tag = text.substr(at, end - at);
    if (is_element(rest, "node")) nodes.open(attribute(tag, "id"));
    if (is_element(rest, "node") && is_empty) nodes.close();
    if (is_element(rest, "instance_node")) nodes.instance(attribute(tag, "url"));
    if (is_element(rest, "up_axis") && depth <= kDepthOfAxes) read_up(text.substr(end + 1), frame);
    if (is_element(rest, "unit") && depth <= kDepthOfAxes) read_unit(tag, frame);
    at = end + 1;
  }
  check_graph(nodes.graph(), max_nodes, "nodes", "instance_node", file);
  return frame;
}

}  // namespace anigen::io::assimp_import
