#include "anigen/io/meshes/ply_header.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "anigen/core/error.h"
#include "anigen/io/meshes/number_text.h"

namespace anigen::io {
namespace {

constexpr std::size_t kMostHeaderBytes = std::size_t{1} << 20;

struct TypeName {
  const char *name, *sized_name;
  PlyType type;
};
constexpr TypeName kTypeNames[] = {{"char", "int8", PlyType::kInt8},        {"uchar", "uint8", PlyType::kUint8},
                                   {"short", "int16", PlyType::kInt16},     {"ushort", "uint16", PlyType::kUint16},
                                   {"int", "int32", PlyType::kInt32},       {"uint", "uint32", PlyType::kUint32},
                                   {"float", "float32", PlyType::kFloat32}, {"double", "float64", PlyType::kFloat64}};

class HeaderParser {
 public:
  HeaderParser(const std::string& bytes, const std::string& file) : bytes_(bytes), file_(file) {}

  PlyHeader parse() {
    if (next_line() != "ply") fail("not a PLY file: the first line is not 'ply'");
    bool has_format = false;
    for (std::string_view line = next_line(); line != "end_header"; line = next_line()) {
      const std::string_view keyword = take_token(line);
      if (keyword == "format") {
        parse_format(line);
        has_format = true;
      } else if (keyword == "element") {
        parse_element(line);
      } else if (keyword == "property") {
        parse_property(line);
      } else if (!keyword.empty() && keyword != "comment" && keyword != "obj_info") {
        fail("unknown keyword '" + std::string(keyword.substr(0, 40)) + "'");
      }
    }
    if (!has_format) fail("the header names no format");
    refuse_hostile_counts();
    return std::move(header_);
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const {
    throw InputError(file_, "line " + std::to_string(std::max<std::size_t>(1, header_.lines)), problem);
  }

  std::string_view next_line() {
    const std::size_t end = bytes_.find('\n', header_.bytes);
    if (end == std::string::npos || end >= kMostHeaderBytes) {
      fail(bytes_.size() > kMostHeaderBytes ? "no end_header within 1 MiB" : "the header is cut short");
    }
    std::string_view line(bytes_.data() + header_.bytes, end - header_.bytes);
    header_.bytes = end + 1;
    ++header_.lines;
    while (!line.empty() && (line.back() == '\r' || line.back() == ' ' || line.back() == '\t')) line.remove_suffix(1);
    return line;
  }

  void parse_format(std::string_view line) {
    const std::string_view name = take_token(line), version = take_token(line);
    if (name == "ascii") {
      header_.format = PlyFormat::kAscii;
    } else if (name == "binary_little_endian") {
      header_.format = PlyFormat::kLittleEndian;
    } else if (name == "binary_big_endian") {
      header_.format = PlyFormat::kBigEndian;
    } else {
      fail("unknown format '" + std::string(name.substr(0, 40)) + "'");
    }
    if (version != "1.0") fail("unknown PLY version '" + std::string(version.substr(0, 40)) + "'");
  }

  void parse_element(std::string_view line) {
    PlyElement element;
    element.name = take_token(line);
    const std::string_view count = take_token(line);
    double value = 0.0;
    if (element.name.empty() || !parse_number(count, value) || value < 0.0 || value != std::floor(value)) {
      fail("an element needs a name and a count");
    }
    if (!(value <= 9e15)) fail("element count beyond every file");
    element.count = static_cast<std::uint64_t>(value);
    header_.elements.push_back(std::move(element));
  }

  void parse_property(std::string_view line) {
    if (header_.elements.empty()) fail("a property before the first element");
    PlyProperty property;
    std::string_view word = take_token(line);
    if (word == "list") {
      property.is_list = true;
      property.count_type = type_named(take_token(line));
      if (!is_integer(property.count_type)) fail("the length of a list must be an integer type");
      word = take_token(line);
    }
    property.type = type_named(word);
    property.name = take_token(line);
    if (property.name.empty()) fail("a property without a name");
    header_.elements.back().properties.push_back(std::move(property));
  }

  PlyType type_named(std::string_view name) const {
    for (const TypeName& known : kTypeNames) {
      if (name == known.name || name == known.sized_name) return known.type;
    }
    fail("unknown type '" + std::string(name.substr(0, 40)) + "'");
  }

  void refuse_hostile_counts() const {
    std::uint64_t left = bytes_.size() - header_.bytes;
    for (const PlyElement& element : header_.elements) {
      const std::uint64_t row = element.least_bytes(header_.format);
      if (row == 0) continue;
      // The last value of an ASCII file may lack its line end.
      const std::uint64_t available = left + (header_.format == PlyFormat::kAscii ? 1 : 0);
      if (element.count > available / row) {
        fail("element " + element.name.substr(0, 40) + " announces " + std::to_string(element.count) +
             " rows, more than the file can hold: it is cut short");
      }
      left = available - element.count * row;
    }
  }

  const std::string& bytes_;
  const std::string& file_;
  PlyHeader header_;
};

}  // namespace

std::size_t size_of(PlyType type) {
  switch (type) {
    case PlyType::kInt8:
    case PlyType::kUint8:
      return 1;
    case PlyType::kInt16:
    case PlyType::kUint16:
      return 2;
    case PlyType::kFloat64:
      return 8;
    default:
      return 4;
  }
}

bool is_integer(PlyType type) { return type != PlyType::kFloat32 && type != PlyType::kFloat64; }

double largest_of(PlyType type) {
  const bool is_signed = type == PlyType::kInt8 || type == PlyType::kInt16 || type == PlyType::kInt32;
  return std::ldexp(1.0, static_cast<int>(8 * size_of(type)) - (is_signed ? 1 : 0)) - 1.0;
}

std::size_t PlyElement::least_bytes(PlyFormat format) const {
  std::size_t bytes = 0;
  for (const PlyProperty& property : properties) {
    // In text, a digit and what separates it from the next.
    bytes += format == PlyFormat::kAscii ? 2 : size_of(property.is_list ? property.count_type : property.type);
  }
  return bytes;
}

PlyHeader parse_ply_header(const std::string& bytes, const std::string& file) {
  return HeaderParser(bytes, file).parse();
}

}  // namespace anigen::io
