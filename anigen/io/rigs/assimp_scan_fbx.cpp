#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdint>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/io/rigs/assimp_scan.h"

namespace anigen::io::assimp_import {
namespace {

constexpr std::size_t kMostNestedRecords = 64, kMostNestedNodes = 1024;
constexpr std::string_view kBinaryMagic = "Kaydara FBX Binary";  // as much of it as Assimp looks at
constexpr std::uint64_t kMostArrayBytes = std::uint64_t{4} << 30;

class BinaryScanner {
 public:
  BinaryScanner(std::string_view bytes, const std::string& file) : bytes_(bytes), file_(file) {}

  SceneGraph scan() {
    constexpr std::size_t kHeader = 27;
    if (bytes_.size() < kHeader) fail(bytes_.size(), "the header is cut short");
    wide_ = number(23, 4) >= 7500;
    const std::size_t field = wide_ ? 8 : 4, head = 3 * field + 1;
    std::size_t at = kHeader;
    while (at + head <= bytes_.size()) {
      if (!open_.empty() && at >= open_.back().end) {
        open_.pop_back();
        continue;
      }
      const std::uint64_t end = number(at, field);
      if (end == 0) {  // closes a list; at the top it ends the file
        if (open_.empty()) break;
        if (at + head != open_.back().end) fail(at, "an empty record stands in the middle of a list");
        at = open_.back().end;
        continue;
      }
      const std::uint64_t properties = number(at + 2 * field, field);
      const std::size_t name_size = static_cast<unsigned char>(bytes_[at + 3 * field]);
      const std::uint64_t limit = open_.empty() ? bytes_.size() : open_.back().end;
      if (end <= at || end > limit) fail(at, "a record does not end inside the one around it");
      const std::size_t first = at + head + name_size;
      if (first > end || properties > end - first) fail(at, "a record's properties do not fit into it");
      const std::string_view name = bytes_.substr(at + head, name_size);
      collect(name, first, first + static_cast<std::size_t>(properties));
      count_arrays(first, first + static_cast<std::size_t>(properties));
      if (first + properties == end) {
        at = static_cast<std::size_t>(end);
        continue;
      }
      if (open_.size() >= kMostNestedRecords)
        fail(at, "records are nested deeper than " + std::to_string(kMostNestedRecords));
      open_.push_back({name, static_cast<std::size_t>(end)});
      at = first + static_cast<std::size_t>(properties);
    }
    return std::move(graph_);
  }

 private:
  struct Open {
    std::string_view name;
    std::size_t end;
  };

  [[noreturn]] void fail(std::size_t at, const std::string& problem) const {
    throw InputError(file_, "byte " + std::to_string(at), problem);
  }

  std::uint64_t number(std::size_t at, std::size_t size) const {  // little-endian
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < size; ++i)
      value |= static_cast<std::uint64_t>(static_cast<unsigned char>(bytes_[at + i])) << (8 * i);
    return value;
  }

  /// A 64-bit property at `at`, which moves behind it.
  bool take_id(std::size_t& at, std::size_t end, std::int64_t& id) const {
    if (at + 9 > end || bytes_[at] != 'L') return false;
    id = static_cast<std::int64_t>(number(at + 1, 8));
    at += 9;
    return true;
  }

  void collect(std::string_view name, std::size_t at, std::size_t end) {
    if (open_.size() != 1) return;
    std::int64_t child = 0, parent = 0;
    if (open_[0].name == "Objects" && name == "Model") {
      if (take_id(at, end, child)) graph_.nodes.push_back(child);
    } else if (open_[0].name == "Connections") {
      if (at + 5 > end || bytes_[at] != 'S') return;
      const std::uint64_t size = number(at + 1, 4);
      if (size > end - at - 5) return;
      at += 5 + static_cast<std::size_t>(size);
      if (take_id(at, end, child) && take_id(at, end, parent)) graph_.links.emplace_back(child, parent);
    }
  }

  /// Adds up what the arrays among a record's properties say they unpack to: Assimp reserves that before it reads.
  void count_arrays(std::size_t at, std::size_t end) {
    while (at < end) {
      const std::size_t start = at;
      const char type = bytes_[at++];
      std::uint64_t size = 0;
      if (type == 'C') {
        size = 1;
      } else if (type == 'Y') {
        size = 2;
      } else if (type == 'I' || type == 'F') {
        size = 4;
      } else if (type == 'D' || type == 'L') {
        size = 8;
      } else if (type == 'S' || type == 'R') {
        if (end - at < 4) return;
        size = 4 + number(at, 4);
      } else if (type == 'c' || type == 'b' || type == 'f' || type == 'i' || type == 'd' || type == 'l') {
        if (end - at < 12) return;
        claimed_ += number(at, 4) * (type == 'c' || type == 'b' ? 1 : type == 'd' || type == 'l' ? 8 : 4);
        size = 12 + number(at + 8, 4);
        if (claimed_ > kMostArrayBytes) fail(start, "the arrays up to here unpack to more than 4 GiB");
      } else {
        return;  // Assimp says what is wrong
      }
      if (size > end - at) return;
      at += static_cast<std::size_t>(size);
    }
  }

  std::string_view bytes_;
  const std::string& file_;
  bool wide_ = false;
  std::uint64_t claimed_ = 0;
  std::vector<Open> open_;
  SceneGraph graph_;
};

/// Statements are `Name: value, value, … { statements }`.
class TextScanner {
 public:
  TextScanner(std::string_view text, const std::string& file) : text_(text), file_(file) {}

  SceneGraph scan() {
    std::size_t at = 0;
    while (at < text_.size()) {
      const char c = text_[at];
      if (c == ';') {
        at = std::min(text_.find('\n', at), text_.size());
      } else if (c == '"') {
        const std::size_t end = text_.find('"', at + 1);
        at = end == std::string_view::npos ? text_.size() : end + 1;
      } else if (c == '{') {
        flush();
        if (open_.size() >= kMostNestedRecords) {
          throw InputError(file_, "byte " + std::to_string(at),
                           "blocks are nested deeper than " + std::to_string(kMostNestedRecords));
        }
        open_.push_back(name_);
        name_ = {};
        ++at;
      } else if (c == '}') {
        flush();
        name_ = {};
        if (!open_.empty()) open_.pop_back();
        ++at;
      } else if (is_word(c)) {
        at = take_word(at);
      } else {
        ++at;
      }
    }
    flush();
    return std::move(graph_);
  }

 private:
  static bool is_word(char c) {
    return std::isspace(static_cast<unsigned char>(c)) == 0 &&
           std::string_view(",{}\":;").find(c) == std::string_view::npos;
  }

  std::size_t take_word(std::size_t at) {
    std::size_t end = at + 1;
    while (end < text_.size() && is_word(text_[end])) ++end;
    const std::string_view word = text_.substr(at, end - at);
    if (end < text_.size() && text_[end] == ':') {
      flush();
      name_ = word;
      return end + 1;
    }
    std::uint64_t value = 0;  // as Assimp reads an id: the digits in front count, whatever follows
    const auto [stop, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error == std::errc() && numbers_.size() < 2) numbers_.push_back(static_cast<std::int64_t>(value));
    return end;
  }

  void flush() {
    if (open_.size() == 1 && open_[0] == "Objects" && name_ == "Model" && !numbers_.empty())
      graph_.nodes.push_back(numbers_[0]);
    if (open_.size() == 1 && open_[0] == "Connections" && numbers_.size() == 2)
      graph_.links.emplace_back(numbers_[0], numbers_[1]);
    numbers_.clear();
  }

  std::string_view text_;
  const std::string& file_;
  std::vector<std::string_view> open_;  ///< names of the blocks around
  std::string_view name_;               ///< of the statement at hand
  std::vector<std::int64_t> numbers_;   ///< its first two whole numbers
  SceneGraph graph_;
};

}  // namespace

// Walks the nodes below the scene in an order that has parents first (Kahn).
void check_graph(const SceneGraph& graph, std::size_t max_nodes, const std::string& what, const std::string& place,
                 const std::string& file) {
  std::unordered_map<std::int64_t, std::size_t> number;
  number.emplace(0, 0);  // the root, which is no object
  for (const std::int64_t node : graph.nodes) number.emplace(node, number.size());
  std::vector<std::vector<std::size_t>> children(number.size());
  std::vector<std::size_t> parents_left(number.size(), 0);
  for (const auto& [child, parent] : graph.links) {
    const auto c = number.find(child), p = number.find(parent);
    if (c == number.end() || p == number.end() || child == 0) continue;
    children[p->second].push_back(c->second);
  }
  std::vector<char> reached(number.size(), 0);
  std::vector<std::size_t> queue = {0};
  reached[0] = 1;
  for (std::size_t k = 0; k < queue.size(); ++k) {
    for (const std::size_t child : children[queue[k]]) {
      ++parents_left[child];
      if (reached[child] != 0) continue;
      reached[child] = 1;
      queue.push_back(child);
    }
  }
  const std::size_t reachable = queue.size();
  std::vector<std::size_t> depth(number.size(), 0);
  std::vector<double> copies(number.size(), 0.0);  // how often the tree that Assimp makes repeats a node
  copies[0] = 1.0;
  double total = 0.0;
  queue = {0};
  for (std::size_t k = 0; k < queue.size(); ++k) {
    const std::size_t one = queue[k];
    total += copies[one];
    if (depth[one] > kMostNestedNodes)
      throw InputError(file, place, what + " are nested deeper than " + std::to_string(kMostNestedNodes));
    for (const std::size_t child : children[one]) {
      copies[child] += copies[one];
      depth[child] = std::max(depth[child], depth[one] + 1);
      if (--parents_left[child] == 0) queue.push_back(child);
    }
  }
  if (queue.size() != reachable)
    throw InputError(file, place,
                     "a " + what.substr(0, what.size() - 1) + " is its own ancestor: the scene graph has a cycle");
  if (!(total <= static_cast<double>(max_nodes)))
    throw InputError(file, place, "the scene graph has more nodes than the limit of " + std::to_string(max_nodes));
}

void scan_fbx(std::string_view bytes, std::size_t max_nodes, const std::string& file) {
  const bool is_binary = bytes.substr(0, kBinaryMagic.size()) == kBinaryMagic;
  const SceneGraph graph = is_binary ? BinaryScanner(bytes, file).scan() : TextScanner(bytes, file).scan();
  check_graph(graph, max_nodes, "models", "Connections", file);
}

}  // namespace anigen::io::assimp_import
