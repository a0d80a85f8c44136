#include "anigen/io/ply.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/obj.h"

namespace anigen::io {

namespace {

enum class PlyFormat { kAscii, kLittleEndian, kBigEndian };
enum class PlyType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };

// Bytes in a binary file.
std::size_t size_of(PlyType type) {
  static constexpr std::size_t kBytes[] = {1, 1, 2, 2, 4, 4, 4, 8};
  return kBytes[static_cast<std::size_t>(type)];
}

bool is_integer(PlyType type) { return type != PlyType::kFloat32 && type != PlyType::kFloat64; }

bool is_signed(PlyType type) { return type == PlyType::kInt8 || type == PlyType::kInt16 || type == PlyType::kInt32; }

// Largest value of an integer type.
double largest_of(PlyType type) {
  return std::ldexp(1.0, static_cast<int>(8 * size_of(type)) - (is_signed(type) ? 1 : 0)) - 1.0;
}

struct PlyProperty {
  std::string name;
  bool is_list = false;
  PlyType count_type = PlyType::kUint8;  //< of a list's length
  PlyType type = PlyType::kFloat32;      //< of the value, or of a list's items
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;

  // Fewest bytes that one row can take in the format: in text, a digit and what separates it from the next.
  std::size_t least_bytes(PlyFormat format) const {
    std::size_t bytes = 0;
    for (const PlyProperty& property : properties)
      bytes += format == PlyFormat::kAscii ? 2 : size_of(property.is_list ? property.count_type : property.type);
    return bytes;
  }
};

struct PlyHeader {
  PlyFormat format = PlyFormat::kAscii;
  std::vector<PlyElement> elements;
  std::size_t bytes = 0, lines = 0;  //< where the data begins
};

constexpr std::size_t kMostHeaderBytes = std::size_t{1} << 20;

struct TypeName {
  const char *name, *sized_name;
  PlyType type;
};
constexpr TypeName kTypeNames[] = {{"char", "int8", PlyType::kInt8},        {"uchar", "uint8", PlyType::kUint8},
                                   {"short", "int16", PlyType::kInt16},     {"ushort", "uint16", PlyType::kUint16},
                                   {"int", "int32", PlyType::kInt32},       {"uint", "uint32", PlyType::kUint32},
                                   {"float", "float32", PlyType::kFloat32}, {"double", "float64", PlyType::kFloat64}};

// Parses everything up to end_header. Headers beyond 1 MiB and elements that could not fit into the rest of the file
// are refused here, so readers may trust the counts.
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
    if (end == std::string::npos || end >= kMostHeaderBytes)
      fail(bytes_.size() > kMostHeaderBytes ? "no end_header within 1 MiB" : "the header is cut short");
    std::string_view line(bytes_.data() + header_.bytes, end - header_.bytes);
    header_.bytes = end + 1;
    ++header_.lines;
    while (!line.empty() && (line.back() == '\r' || line.back() == ' ' || line.back() == '\t')) line.remove_suffix(1);
    return line;
  }

  void parse_format(std::string_view line) {
    const std::string_view name = take_token(line), version = take_token(line);
    constexpr std::string_view kFormats[] = {"ascii", "binary_little_endian", "binary_big_endian"};
    const auto* known = std::find(std::begin(kFormats), std::end(kFormats), name);
    if (known == std::end(kFormats)) fail("unknown format '" + std::string(name.substr(0, 40)) + "'");
    header_.format = static_cast<PlyFormat>(known - kFormats);
    if (version != "1.0") fail("unknown PLY version '" + std::string(version.substr(0, 40)) + "'");
  }

  void parse_element(std::string_view line) {
    PlyElement element;
    element.name = take_token(line);
    const std::string_view count = take_token(line);
    double value = 0.0;
    if (element.name.empty() || !parse_number(count, value) || value < 0.0 || value != std::floor(value))
      fail("an element needs a name and a count");
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

bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n' || c == '\v' || c == '\f'; }

// Reads the values behind a PLY header one after the other, whichever way they are stored. Every double holds every
// value of every PLY type.
class PlyValues {
 public:
  PlyValues(const std::string& bytes, const PlyHeader& header, const std::string& file)
      : bytes_(bytes), file_(file), format_(header.format), at_(header.bytes), line_(header.lines + 1) {}

  // @throws InputError at the end of the data, on text that is no number, or that does not fit the type
  double next(PlyType type) { return format_ == PlyFormat::kAscii ? next_text(type) : next_binary(type); }
  // The length of a list whose items follow. @throws InputError when it is negative or exceeds the file
  std::size_t next_length(const PlyProperty& property) {
    const double length = next(property.count_type);
    if (length < 0.0) fail("a list of negative length");
    const double item = format_ == PlyFormat::kAscii ? 2.0 : static_cast<double>(size_of(property.type));
    if (length * item > static_cast<double>(bytes_.size() - at_) + 1.0)
      fail("a list of " + std::to_string(static_cast<std::uint64_t>(length)) + " items reaches beyond the end");
    return static_cast<std::size_t>(length);
  }

  [[noreturn]] void fail(const std::string& problem) const {
    const bool text = format_ == PlyFormat::kAscii;
    throw InputError(file_, text ? "line " + std::to_string(line_) : "byte " + std::to_string(at_), problem);
  }

 private:
  double next_text(PlyType type) {
    for (; at_ < bytes_.size() && is_blank(bytes_[at_]); ++at_) line_ += bytes_[at_] == '\n' ? 1 : 0;
    if (at_ == bytes_.size()) fail("the file ends too early");
    const std::size_t begin = at_;
    while (at_ < bytes_.size() && !is_blank(bytes_[at_])) ++at_;
    const std::string_view token(bytes_.data() + begin, at_ - begin);
    double value = 0.0;
    if (!parse_number(token, value)) fail("'" + std::string(token.substr(0, 40)) + "' is not a number");
    if (is_integer(type)) {
      const double high = largest_of(type);
      const double low = is_signed(type) ? -high - 1.0 : 0.0;
      if (!(value >= low && value <= high) || value != std::floor(value))
        fail("'" + std::string(token.substr(0, 40)) + "' does not fit its integer type");
    }
    return value;
  }

  double next_binary(PlyType type) {
    const std::size_t size = size_of(type);
    if (bytes_.size() - at_ < size) fail("the file ends too early");
    std::uint64_t bits = 0;
    for (std::size_t i = 0; i < size; ++i) {
      const std::size_t source = format_ == PlyFormat::kBigEndian ? i : size - 1 - i;
      bits = bits << 8 | static_cast<unsigned char>(bytes_[at_ + source]);
    }
    at_ += size;
    if (type == PlyType::kFloat32) return Eigen::numext::bit_cast<float>(static_cast<std::uint32_t>(bits));
    if (type == PlyType::kFloat64) return Eigen::numext::bit_cast<double>(bits);
    if (!is_signed(type)) return static_cast<double>(bits);
    const std::size_t unused = 8 * (sizeof bits - size);
    return static_cast<double>(static_cast<std::int64_t>(bits << unused) >> unused);
  }

  const std::string& bytes_;
  const std::string& file_;
  PlyFormat format_;
  std::size_t at_, line_;
};

constexpr std::uintmax_t kMostPlyBytes = std::uintmax_t{4} << 30;

// Destination of a vertex property; the numbers of one vertex are gathered in this order.
enum Slot { kX, kY, kZ, kNx, kNy, kNz, kRed, kGreen, kBlue, kAlpha, kU, kV, kSlots, kNone };

Slot slot_named(const std::string& name) {
  static const std::vector<std::string> slot_names[kSlots] = {{"x"},
                                                              {"y"},
                                                              {"z"},
                                                              {"nx"},
                                                              {"ny"},
                                                              {"nz"},
                                                              {"red", "r", "diffuse_red"},
                                                              {"green", "g", "diffuse_green"},
                                                              {"blue", "b", "diffuse_blue"},
                                                              {"alpha", "a"},
                                                              {"s", "u", "texture_u"},
                                                              {"t", "v", "texture_v"}};
  const auto* found =
      std::find_if(std::begin(slot_names), std::end(slot_names), [&](const std::vector<std::string>& names) {
        return std::find(names.begin(), names.end(), name) != names.end();
      });
  return found == std::end(slot_names) ? kNone : static_cast<Slot>(found - slot_names);
}

void skip(PlyValues& values, const PlyProperty& property) {
  const std::size_t length = property.is_list ? values.next_length(property) : 1;
  for (std::size_t i = 0; i < length; ++i) values.next(property.type);
}

class VertexReader {
 public:
  VertexReader(const PlyElement& element, const std::string& file) : element_(element) {
    scale_.fill(1.0);
    for (const PlyProperty& property : element.properties) {
      const Slot slot = property.is_list ? kNone : slot_named(property.name);
      slots_.push_back(slot);
      if (slot == kNone) continue;
      has_[slot] = true;
      // Integer colours span their type; floating ones are already in [0, 1].
      if (slot >= kRed && slot <= kAlpha && is_integer(property.type)) scale_[slot] = 1.0 / largest_of(property.type);
    }
    if (!has_[kX] || !has_[kY] || !has_[kZ]) throw InputError(file, "", "vertices without x, y and z");
  }

  void read(PlyValues& values, Mesh& mesh) const {
    const bool normals = has_[kNx] && has_[kNy] && has_[kNz], colors = has_[kRed] && has_[kGreen] && has_[kBlue];
    const bool uvs = has_[kU] && has_[kV];
    mesh.vertices.reserve(static_cast<std::size_t>(element_.count));
    for (std::uint64_t v = 0; v < element_.count; ++v) {
      std::array<double, kNone + 1> row{};
      row[kAlpha] = 1.0;
      for (std::size_t p = 0; p < slots_.size(); ++p) {
        const PlyProperty& property = element_.properties[p];
        if (property.is_list) {
          skip(values, property);
        } else {
          row[slots_[p]] = values.next(property.type) * scale_[slots_[p]];
        }
      }
      mesh.vertices.push_back(finite3(values, row, kX));
      if (normals) mesh.normals.push_back(unit_normal(finite3(values, row, kNx)));
      if (uvs) mesh.uvs.push_back({finite(values, row[kU]), finite(values, 1.0 - row[kV])});
      if (colors) {
        Eigen::Vector4f color;
        for (int k = 0; k < 4; ++k)
          color[k] = std::clamp(finite(values, row[kRed + static_cast<std::size_t>(k)]), 0.0f, 1.0f);
        mesh.colors.push_back(color);
      }
    }
  }

 private:
  static float finite(const PlyValues& values, double number) {
    const auto value = static_cast<float>(number);
    if (!std::isfinite(value)) values.fail("a vertex has a number that is not finite");
    return value;
  }
  static Eigen::Vector3f finite3(const PlyValues& values, const std::array<double, kNone + 1>& row, std::size_t slot) {
    return {finite(values, row[slot]), finite(values, row[slot + 1]), finite(values, row[slot + 2])};
  }

  const PlyElement& element_;
  std::vector<Slot> slots_;
  std::array<bool, kNone + 1> has_{};
  std::array<double, kNone + 1> scale_;
};

void read_polygon(PlyValues& values, const PlyProperty& property, std::uint64_t vertices, Mesh& mesh) {
  const std::size_t corners = values.next_length(property);
  if (corners < 3) values.fail("a face needs at least 3 corners, found " + std::to_string(corners));
  std::int32_t hub = 0, previous = 0;
  for (std::size_t c = 0; c < corners; ++c) {
    const double index = values.next(property.type);
    if (index < 0.0 || index >= static_cast<double>(vertices)) {
      values.fail("a face refers to vertex " + std::to_string(static_cast<std::int64_t>(index)) + " of " +
                  std::to_string(vertices));
    }
    const auto corner = static_cast<std::int32_t>(index);
    if (c == 0) hub = corner;
    if (c >= 2) mesh.faces.push_back({hub, previous, corner});
    previous = corner;
  }
}

bool is_polygon(const PlyProperty& property) {
  return property.is_list && (property.name == "vertex_indices" || property.name == "vertex_index");
}

void read_faces(PlyValues& values, const PlyElement& element, std::uint64_t vertices, Mesh& mesh) {
  const auto& properties = element.properties;
  const auto polygon = std::find_if(properties.begin(), properties.end(), is_polygon);
  if (polygon == properties.end()) values.fail("faces without a list vertex_indices");
  if (!is_integer(polygon->type)) values.fail("vertex_indices must be of an integer type");
  for (std::uint64_t f = 0; f < element.count; ++f) {
    for (auto property = properties.begin(); property != properties.end(); ++property) {
      if (property == polygon)
        read_polygon(values, *property, vertices, mesh);
      else
        skip(values, *property);
    }
  }
}

void skip_element(PlyValues& values, const PlyElement& element) {
  if (element.properties.empty()) return;
  for (std::uint64_t row = 0; row < element.count; ++row) {
    for (const PlyProperty& property : element.properties) skip(values, property);
  }
}

const PlyElement* element_named(const PlyHeader& header, const char* name) {
  const auto found = std::find_if(header.elements.begin(), header.elements.end(),
                                  [name](const PlyElement& element) { return element.name == name; });
  return found == header.elements.end() ? nullptr : &*found;
}

}  // namespace

Mesh read_ply(const std::filesystem::path& path) {
  const std::string file = path.string();
  const std::string bytes = read_file(path, kMostPlyBytes);
  const PlyHeader header = HeaderParser(bytes, file).parse();
  const PlyElement* vertices = element_named(header, "vertex");
  const PlyElement* faces = element_named(header, "face");
  if (vertices == nullptr || vertices->count == 0) throw InputError(file, "", "no vertices");
  if (faces == nullptr && element_named(header, "tristrips") != nullptr)
    throw NotSupportedError(file, "", "triangle strips in PLY");
  const VertexReader vertex_reader(*vertices, file);
  face_index(static_cast<std::size_t>(vertices->count), file);
  Mesh mesh;
  PlyValues values(bytes, header, file);
  for (const PlyElement& element : header.elements) {
    if (&element == vertices) {
      vertex_reader.read(values, mesh);
    } else if (&element == faces) {
      read_faces(values, element, vertices->count, mesh);
    } else {
      skip_element(values, element);
    }
  }
  return mesh;
}

namespace {

// Least significant byte first, whatever the machine.
void append_uint32(std::string& bytes, std::uint32_t value) {
  for (int shift = 0; shift < 32; shift += 8) bytes.push_back(static_cast<char>(value >> shift & 0xFF));
}

void append_float(std::string& bytes, float value) {
  append_uint32(bytes, Eigen::numext::bit_cast<std::uint32_t>(value));
}

std::string header(const Mesh& mesh) {
  std::string text = "ply\nformat binary_little_endian 1.0\ncomment AniGen in C++\n";
  text += "element vertex " + std::to_string(mesh.vertices.size()) + "\n";
  for (const char* name : {"x", "y", "z"}) text += std::string("property float ") + name + "\n";
  if (!mesh.normals.empty()) text += "property float nx\nproperty float ny\nproperty float nz\n";
  if (!mesh.uvs.empty()) text += "property float s\nproperty float t\n";
  if (!mesh.colors.empty()) {
    for (const char* name : {"red", "green", "blue", "alpha"}) text += std::string("property uchar ") + name + "\n";
  }
  if (!mesh.faces.empty())
    text += "element face " + std::to_string(mesh.faces.size()) + "\nproperty list uchar int vertex_indices\n";
  return text + "end_header\n";
}

}  // namespace

void write_ply(const std::filesystem::path& path, const Mesh& mesh) {
  refuse_unsound_mesh(mesh, path.string());
  std::string bytes = header(mesh);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    for (const float x : mesh.vertices[v]) append_float(bytes, x);
    if (!mesh.normals.empty()) {
      for (const float x : mesh.normals[v]) append_float(bytes, x);
    }
    if (!mesh.uvs.empty()) {
      append_float(bytes, mesh.uvs[v].x());
      append_float(bytes, 1.0f - mesh.uvs[v].y());
    }
    if (!mesh.colors.empty()) {
      for (const float x : mesh.colors[v])
        bytes.push_back(static_cast<char>(std::lround(255.0f * std::clamp(x, 0.0f, 1.0f))));
    }
  }
  for (const Triangle& face : mesh.faces) {
    bytes.push_back(3);
    for (const std::int32_t v : face) append_uint32(bytes, static_cast<std::uint32_t>(v));
  }
  write_file_atomically(path, bytes);
}

}  // namespace anigen::io
