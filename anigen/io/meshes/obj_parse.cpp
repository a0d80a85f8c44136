#include <algorithm>
#include <cmath>
#include <string_view>

#include "anigen/core/error.h"
#include "anigen/io/meshes/number_text.h"
#include "anigen/io/meshes/obj_file.h"

namespace anigen::io {
namespace {

class ObjParser {
 public:
  ObjParser(const std::string& text, const std::string& file) : rest_(text), file_(file) {}

  ObjFile parse() {
    std::string joined;
    std::string_view line;
    while (next_line(line, joined)) parse_line(line.substr(0, line.find('#')));
    check_indices();
    return std::move(obj_);
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const { fail_at(line_, problem); }
  [[noreturn]] void fail_at(std::size_t line, const std::string& problem) const {
    throw InputError(file_, "line " + std::to_string(line), problem);
  }

  // One physical line, without its end.
  std::string_view take_physical_line() {
    const std::size_t end = rest_.find('\n');
    std::string_view line = rest_.substr(0, end);
    rest_ = end == std::string_view::npos ? std::string_view() : rest_.substr(end + 1);
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    ++physical_lines_;
    return line;
  }

  // One logical line: a backslash at the end continues it on the next, unless it ends a comment (a folder's name).
  bool next_line(std::string_view& line, std::string& joined) {
    if (rest_.empty()) return false;
    line_ = physical_lines_ + 1;
    line = take_physical_line();
    if (line.empty() || line.back() != '\\' || line.find('#') != std::string_view::npos) return true;
    joined.clear();
    while (!line.empty() && line.back() == '\\') {
      joined += line.substr(0, line.size() - 1);
      joined += ' ';
      line = take_physical_line();
    }
    joined += line;
    line = joined;
    return true;
  }

  void parse_line(std::string_view line) {
    const std::string_view keyword = take_token(line);
    if (keyword == "v") {
      parse_position(line);
    } else if (keyword == "vt") {
      read_numbers(line, 1, 3);
      obj_.uvs.emplace_back(number(0), count_ > 1 ? static_cast<float>(1.0 - numbers_[1]) : 1.0f);
    } else if (keyword == "vn") {
      read_numbers(line, 3, 3);
      obj_.normals.emplace_back(number(0), number(1), number(2));
    } else if (keyword == "f" || keyword == "fo") {
      parse_face(line);
    }
  }

  float number(std::size_t i) const { return static_cast<float>(numbers_[i]); }

  void read_numbers(std::string_view line, std::size_t at_least, std::size_t at_most) {
    count_ = 0;
    for (std::string_view token = take_token(line); !token.empty(); token = take_token(line)) {
      if (count_ == at_most) fail("more than " + std::to_string(at_most) + " numbers");
      double& value = numbers_[count_++];
      if (!parse_number(token, value)) fail("'" + std::string(token.substr(0, 40)) + "' is not a number");
      if (!std::isfinite(static_cast<float>(value))) fail("a number is not finite");
    }
    if (count_ < at_least) {
      fail("expected " + std::to_string(at_least) + " numbers, found " + std::to_string(count_));
    }
  }

  // x y z [w], or x y z r g b [a] as MeshLab, ZBrush and others write colours. w matters to curves only.
  void parse_position(std::string_view line) {
    read_numbers(line, 3, 7);
    if (count_ == 5) fail("a vertex has 3 or 4 coordinates and 3 or 4 colour values, found 5 numbers");
    obj_.positions.emplace_back(number(0), number(1), number(2));
    if (count_ < 6 && obj_.colors.empty()) return;
    obj_.colors.resize(obj_.positions.size(), Eigen::Vector4f::Ones());
    for (std::size_t k = 3; k < count_ && count_ >= 6; ++k) {
      obj_.colors.back()[static_cast<Eigen::Index>(k - 3)] = std::clamp(number(k), 0.0f, 1.0f);
    }
  }

  void parse_face(std::string_view line) {
    const std::size_t first = obj_.corners.size();
    for (std::string_view token = take_token(line); !token.empty(); token = take_token(line)) {
      obj_.corners.push_back(parse_corner(token));
    }
    const std::size_t found = obj_.corners.size() - first;
    if (found < 3) fail("a face needs at least 3 corners, found " + std::to_string(found));
    obj_.polygons.push_back({first, line_});
  }

  // v, v/vt, v//vn or v/vt/vn; negative numbers count back from the latest entry.
  ObjFile::Corner parse_corner(std::string_view token) const {
    const std::int64_t counts[3] = {static_cast<std::int64_t>(obj_.positions.size()),
                                    static_cast<std::int64_t>(obj_.uvs.size()),
                                    static_cast<std::int64_t>(obj_.normals.size())};
    ObjFile::Corner corner = {-1, -1, -1};
    std::string_view left = token;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::size_t slash = left.find('/');
      const std::string_view part = left.substr(0, slash);
      if (!part.empty()) corner[k] = parse_index(part, counts[k]);
      if (slash == std::string_view::npos) {
        if (corner[0] < 0) break;
        return corner;
      }
      left = left.substr(slash + 1);
    }
    fail("'" + std::string(token.substr(0, 40)) + "' is not a corner like 1, 1/2, 1//3 or 1/2/3");
  }

  std::int64_t parse_index(std::string_view text, std::int64_t count) const {
    double value = 0.0;
    if (!parse_number(text, value) || !(std::abs(value) < 1e15) || value != std::floor(value)) {
      fail("'" + std::string(text.substr(0, 40)) + "' is not an index");
    }
    const auto index = static_cast<std::int64_t>(value);
    if (index == 0) fail("index 0: indices count from 1");
    if (index > 0) return index - 1;  // may refer forward; check_indices() decides
    if (-index > count)
      fail("index " + std::to_string(index) + " reaches before the first of " + std::to_string(count));
    return count + index;
  }

  void check_indices() const {
    static constexpr const char* kLists[3] = {"vertex", "texture coordinate", "normal"};
    const std::size_t sizes[3] = {obj_.positions.size(), obj_.uvs.size(), obj_.normals.size()};
    std::size_t polygon = 0;
    for (std::size_t c = 0; c < obj_.corners.size(); ++c) {
      while (polygon + 1 < obj_.polygons.size() && obj_.polygons[polygon + 1].first_corner <= c) ++polygon;
      for (std::size_t k = 0; k < 3; ++k) {
        const std::int64_t index = obj_.corners[c][k];
        if (index < 0 || static_cast<std::size_t>(index) < sizes[k]) continue;
        fail_at(obj_.polygons[polygon].line, std::string(kLists[k]) + " " + std::to_string(index + 1) +
                                                 " does not exist: the file has " + std::to_string(sizes[k]));
      }
    }
  }

  std::string_view rest_;
  const std::string& file_;
  ObjFile obj_;
  std::size_t physical_lines_ = 0, line_ = 0;
  std::array<double, 7> numbers_{};
  std::size_t count_ = 0;
};

}  // namespace

ObjFile parse_obj(const std::string& text, const std::string& file) {
  refuse_utf16(text, file);
  return ObjParser(text, file).parse();
}

}  // namespace anigen::io
