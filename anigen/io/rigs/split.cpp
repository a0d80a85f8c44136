#include "anigen/io/rigs/split.h"

#include <algorithm>
#include <map>
#include <set>
#include <string_view>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"

namespace anigen::io {

std::vector<SplitLine> split_lines(const std::filesystem::path& file) {
  constexpr std::string_view kBlanks = " \t\r\v\f";
  const std::string text = read_file(file, std::uintmax_t{1} << 28);
  std::vector<SplitLine> lines;
  std::size_t number = 0;
  for (std::size_t start = 0; start < text.size();) {
    const std::size_t end = std::min(text.find('\n', start), text.size());
    std::string_view line = std::string_view(text).substr(start, end - start);
    start = end + 1;
    ++number;
    const std::size_t first = line.find_first_not_of(kBlanks);
    if (first == std::string_view::npos || line[first] == '#') continue;
    line = line.substr(first, line.find_last_not_of(kBlanks) - first + 1);
    lines.push_back({std::string(line), number});
  }
  return lines;
}

std::vector<SplitLine> read_split(const std::filesystem::path& file) {
  std::vector<SplitLine> lines = split_lines(file);
  if (lines.empty()) throw InputError(file.string(), "", "the split names no id");
  return lines;
}

std::vector<std::string> select_ids(const ShapeSource& source, const std::vector<std::filesystem::path>& splits,
                                    std::size_t most) {
  std::vector<std::string> all = source.ids();
  if (splits.empty()) {
    if (most > 0 && all.size() > most) all.resize(most);
    return all;
  }
  const std::set<std::string> known(all.begin(), all.end());
  std::map<std::string, std::vector<std::string>> named;  // by other name
  for (const std::string& id : all) {
    for (const std::string& name : short_names(source, id)) named[name].push_back(id);
  }
  std::set<std::string> wanted;
  for (const std::filesystem::path& split : splits) {
    for (const SplitLine& line : read_split(split)) {
      if (most > 0 && wanted.size() == most) break;
      const auto other = named.find(line.id);
      if (known.count(line.id) > 0) {
        wanted.insert(line.id);
      } else if (other != named.end() && other->second.size() == 1) {
        wanted.insert(other->second.front());
      } else {
        throw InputError(split.string(), "line " + std::to_string(line.line),
                         (other == named.end() ? "there is no \"" : "several shapes are called \"") + line.id +
                             "\" in " + source.describe());
      }
    }
  }
  std::vector<std::string> selected;
  for (const std::string& id : all) {
    if (wanted.count(id) > 0) selected.push_back(id);
  }
  return selected;
}

}  // namespace anigen::io
