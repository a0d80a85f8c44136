#include "anigen/io/obj.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <numeric>
#include <system_error>
#include <unordered_map>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/numeric.h"
#include "anigen/io/gltf/export.h"

namespace anigen::io {

namespace {

constexpr std::string_view kBlanks = " \t\r\n\v\f";

}  // namespace

bool parse_number(std::string_view token, double& value) {
  if (!token.empty() && token.front() == '+') token.remove_prefix(1);
  if (token.empty() || token.front() == '+') return false;
  const char* end = token.data() + token.size();
  const std::from_chars_result result = std::from_chars(token.data(), end, value);
  return result.ec == std::errc() && result.ptr == end;
}

std::string_view take_token(std::string_view& text) {
  const std::size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) {
    text = {};
    return {};
  }
  const std::size_t end = text.find_first_of(kBlanks, begin);
  const std::string_view token = text.substr(begin, end == std::string_view::npos ? end : end - begin);
  text = end == std::string_view::npos ? std::string_view() : text.substr(end);
  return token;
}

std::string_view trimmed(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlanks) + 1 - begin);
}

bool TextLines::next_line() {
  if (rest_.empty()) return false;
  ++line_;
  const std::size_t end = rest_.find('\n');
  left_ = rest_.substr(0, end);
  rest_ = end == std::string_view::npos ? std::string_view() : rest_.substr(end + 1);
  return true;
}

double TextLines::number(std::string_view token) const {
  double value = 0.0;
  if (!parse_number(token, value)) fail("\"" + std::string(token.substr(0, 40)) + "\" is not a number");
  if (!std::isfinite(value)) fail("\"" + std::string(token.substr(0, 40)) + "\" is not finite");
  return value;
}

void TextLines::fail(const std::string& problem) const {
  throw InputError(file_, "line " + std::to_string(std::max<std::size_t>(line_, 1)), problem);
}

void refuse_utf16(std::string_view bytes, const std::string& file) {
  using std::string_view_literals::operator""sv;
  const std::string_view mark = bytes.substr(0, 2);
  if (mark == "\xFF\xFE"sv || mark == "\xFE\xFF"sv || mark == "<\0"sv || mark == "\0<"sv)
    throw NotSupportedError(file, "byte 0", "text in UTF-16; convert it: iconv -f UTF-16 -t UTF-8");
}

namespace {

template <typename Vector>
void check_array(const std::vector<Vector>& array, const char* name, std::size_t vertices, const std::string& file) {
  if (!array.empty() && array.size() != vertices) {
    throw InputError(file, "",
                     std::string("mesh has ") + std::to_string(array.size()) + " " + name + " for " +
                         std::to_string(vertices) + " vertices");
  }
  for (std::size_t i = 0; i < array.size(); ++i) {
    if (!array[i].allFinite())
      throw InputError(file, "", std::string(name) + "[" + std::to_string(i) + "] is not finite");
  }
}

}  // namespace

void refuse_unsound_mesh(const Mesh& mesh, const std::string& file) {
  const std::size_t count = mesh.vertices.size();
  if (count == 0) throw InputError(file, "", "mesh has no vertices to write");
  face_index(count, file);
  check_array(mesh.vertices, "vertices", count, file);
  check_array(mesh.normals, "normals", count, file);
  check_array(mesh.uvs, "uvs", count, file);
  check_array(mesh.colors, "colors", count, file);
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    for (const std::int32_t v : mesh.faces[f]) {
      if (v >= 0 && static_cast<std::size_t>(v) < count) continue;
      throw InputError(
          file, "",
          "faces[" + std::to_string(f) + "] refers to vertex " + std::to_string(v) + " of " + std::to_string(count));
    }
  }
}

Eigen::Vector3f unit_normal(const Eigen::Vector3f& normal) {
  const Eigen::Vector3d n = normal.cast<double>();
  const double length = n.norm();
  return length > 1e-30 ? Eigen::Vector3f((n / length).cast<float>()) : Eigen::Vector3f(Eigen::Vector3f::UnitZ());
}

std::int32_t face_index(std::size_t index, const std::string& file) {
  if (index > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max()))
    throw InputError(file, "", "mesh has more than 2^31 - 1 vertices");
  return static_cast<std::int32_t>(index);
}

namespace {

class ObjParser : TextLines {
 public:
  ObjParser(const std::string& text, const std::string& file) : TextLines(text, file) {}

  ObjFile parse() {
    std::string joined;
    std::string_view line;
    while (next_logical_line(line, joined)) parse_line(line.substr(0, line.find('#')));
    check_indices();
    return std::move(obj_);
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const { fail_at(first_line_, problem); }
  [[noreturn]] void fail_at(std::size_t line, const std::string& problem) const {
    throw InputError(file_, "line " + std::to_string(line), problem);
  }

  // One physical line, without its end.
  std::string_view take_physical_line() {
    if (!next_line()) return {};
    if (!left_.empty() && left_.back() == '\r') left_.remove_suffix(1);
    return left_;
  }

  // One logical line: a backslash at the end continues it on the next, unless it ends a comment (a folder's name).
  bool next_logical_line(std::string_view& line, std::string& joined) {
    if (rest_.empty()) return false;
    first_line_ = line_ + 1;
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
    } else if (keyword == "usemtl") {
      use_material(std::string(trimmed(line)));
    } else if (keyword == "mtllib") {
      // Several names may stand in a line, and a name may hold blanks: those that end in .mtl tell.
      const std::string_view all = trimmed(line);
      std::size_t begin = 0;
      for (std::size_t end = all.find(".mtl "); end != std::string_view::npos; end = all.find(".mtl ", begin)) {
        obj_.materials.libraries.emplace_back(trimmed(all.substr(begin, end + 4 - begin)));
        begin = end + 5;
      }
      if (begin < all.size()) obj_.materials.libraries.emplace_back(trimmed(all.substr(begin)));
    }
  }

  void use_material(const std::string& name) {
    const auto [known, is_new] = material_.try_emplace(name, static_cast<std::int32_t>(obj_.materials.names.size()));
    if (is_new) obj_.materials.names.push_back(name);
    current_ = known->second;
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
    if (count_ < at_least) fail("expected " + std::to_string(at_least) + " numbers, found " + std::to_string(count_));
  }

  // x y z [w], or x y z r g b [a] as MeshLab, ZBrush and others write colours. w matters to curves only.
  void parse_position(std::string_view line) {
    read_numbers(line, 3, 7);
    if (count_ == 5) fail("a vertex has 3 or 4 coordinates and 3 or 4 colour values, found 5 numbers");
    obj_.positions.emplace_back(number(0), number(1), number(2));
    if (count_ < 6 && obj_.colors.empty()) return;
    obj_.colors.resize(obj_.positions.size(), Eigen::Vector4f::Ones());
    for (std::size_t k = 3; k < count_ && count_ >= 6; ++k)
      obj_.colors.back()[static_cast<Eigen::Index>(k - 3)] = std::clamp(number(k), 0.0f, 1.0f);
  }

  void parse_face(std::string_view line) {
    const std::size_t first = obj_.corners.size();
    for (std::string_view token = take_token(line); !token.empty(); token = take_token(line))
      obj_.corners.push_back(parse_corner(token));
    const std::size_t found = obj_.corners.size() - first;
    if (found < 3) fail("a face needs at least 3 corners, found " + std::to_string(found));
    obj_.polygons.push_back({first, first_line_, current_});
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
    if (!parse_number(text, value) || !(std::abs(value) < 1e15) || value != std::floor(value))
      fail("'" + std::string(text.substr(0, 40)) + "' is not an index");
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

  ObjFile obj_;
  std::unordered_map<std::string, std::int32_t> material_;
  std::int32_t current_ = -1;
  std::size_t first_line_ = 0;  // of the logical line
  std::array<double, 7> numbers_{};
  std::size_t count_ = 0;
};

}  // namespace

ObjFile parse_obj(const std::string& text, const std::string& file) {
  refuse_utf16(text, file);
  return ObjParser(text, file).parse();
}

namespace {

constexpr std::uintmax_t kMostObjBytes = std::uintmax_t{2} << 30;

// For every entry the first one with the same numbers: tools that write a normal per corner repeat most of them,
// and vertices should split only where something differs.
template <typename Vector>
std::vector<std::int64_t> first_equal(const std::vector<Vector>& entries) {
  const auto less = [&](std::int64_t a, std::int64_t b) {
    const Vector& va = entries[at(a)];
    const Vector& vb = entries[at(b)];
    for (Eigen::Index k = 0; k < va.size(); ++k) {
      if (va[k] != vb[k]) return va[k] < vb[k];
    }
    return false;
  };
  std::vector<std::int64_t> order(entries.size()), first(entries.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), less);
  for (std::size_t i = 0; i < order.size(); ++i) {
    const bool repeats = i > 0 && !less(order[i - 1], order[i]);
    first[at(order[i])] = repeats ? first[at(order[i - 1])] : order[i];
  }
  return first;
}

struct CornerHash {
  std::size_t operator()(const ObjFile::Corner& corner) const {
    std::uint64_t hash = 0;
    for (const std::int64_t index : corner) hash = (hash ^ static_cast<std::uint64_t>(index)) * 0x9E3779B97F4A7C15u + 1;
    return static_cast<std::size_t>(hash ^ hash >> 32);
  }
};

// The first corner at a position keeps the position's number, so a file without seams keeps its vertex order;
// other combinations of texture coordinate and normal become vertices behind the last.
class VertexSplitter {
 public:
  VertexSplitter(const ObjFile& obj, const std::string& file)
      : file_(file),
        first_use_(obj.positions.size(), kUnused),
        uv_(first_equal(obj.uvs)),
        normal_(first_equal(obj.normals)) {
    for (std::size_t v = 0; v < obj.positions.size(); ++v) vertices_.push_back({static_cast<std::int64_t>(v), -1, -1});
  }

  std::int32_t vertex(ObjFile::Corner corner) {
    if (corner[1] >= 0) corner[1] = uv_[at(corner[1])];
    if (corner[2] >= 0) corner[2] = normal_[at(corner[2])];
    const auto position = static_cast<std::size_t>(corner[0]);
    if (first_use_[position] == kUnused) {
      first_use_[position] = 1;
      vertices_[position] = corner;
    }
    if (vertices_[position] == corner) return face_index(position, file_);
    const auto [entry, is_new] = split_.try_emplace(corner, 0);
    if (is_new) {
      entry->second = face_index(vertices_.size(), file_);
      vertices_.push_back(corner);
    }
    return entry->second;
  }

  const std::vector<ObjFile::Corner>& vertices() const { return vertices_; }

 private:
  static constexpr char kUnused = 0;
  const std::string& file_;
  std::vector<char> first_use_;
  std::vector<std::int64_t> uv_, normal_;
  std::vector<ObjFile::Corner> vertices_;
  std::unordered_map<ObjFile::Corner, std::int32_t, CornerHash> split_;
};

void add_faces(const ObjFile& obj, VertexSplitter& splitter, Mesh& mesh) {
  for (std::size_t p = 0; p < obj.polygons.size(); ++p) {
    const std::size_t begin = obj.polygons[p].first_corner;
    const std::size_t end = p + 1 < obj.polygons.size() ? obj.polygons[p + 1].first_corner : obj.corners.size();
    const std::int32_t hub = splitter.vertex(obj.corners[begin]);
    std::int32_t previous = splitter.vertex(obj.corners[begin + 1]);
    for (std::size_t c = begin + 2; c < end; ++c) {
      const std::int32_t next = splitter.vertex(obj.corners[c]);
      mesh.faces.push_back({hub, previous, next});
      if (!obj.materials.names.empty()) mesh.face_materials.push_back(obj.polygons[p].material);
      previous = next;
    }
  }
}

void add_vertices(const ObjFile& obj, const std::vector<ObjFile::Corner>& vertices, Mesh& mesh) {
  const auto names = [&](std::size_t part) {
    return std::any_of(vertices.begin(), vertices.end(), [part](const ObjFile::Corner& c) { return c[part] >= 0; });
  };
  const bool has_uvs = names(1), has_normals = names(2);
  for (const ObjFile::Corner& corner : vertices) {
    mesh.vertices.push_back(obj.positions[at(corner[0])]);
    if (!obj.colors.empty()) mesh.colors.push_back(obj.colors[at(corner[0])]);
    if (has_uvs) mesh.uvs.push_back(corner[1] >= 0 ? obj.uvs[at(corner[1])] : Eigen::Vector2f::Zero());
  }
  if (!has_normals) return;
  mesh.normals = vertex_normals(mesh.vertices, mesh.faces);  // for corners that name none
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    if (vertices[v][2] >= 0) mesh.normals[v] = unit_normal(obj.normals[at(vertices[v][2])]);
  }
}

}  // namespace

Mesh read_obj(const std::filesystem::path& path, ObjMaterials* materials) {
  const std::string file = path.string();
  ObjFile obj = parse_obj(read_file(path, kMostObjBytes), file);
  if (materials == nullptr) obj.materials = {};
  if (obj.positions.empty()) throw InputError(file, "", "no vertices: not an OBJ file, or an empty one");
  Mesh mesh;
  VertexSplitter splitter(obj, file);
  add_faces(obj, splitter, mesh);
  add_vertices(obj, splitter.vertices(), mesh);
  if (materials != nullptr) *materials = std::move(obj.materials);
  return mesh;
}

void write_obj_rig(const std::filesystem::path& obj, const Asset& asset, ExportAxes axes) {
  if (asset.skin.rows() != asset.mesh.vertices.size())
    throw InputError(obj.string(), "", "as many rows of skin weights as vertices are needed");
  const Eigen::Matrix3d rotation = axis_rotation(axes);
  const Eigen::Matrix3f turn = rotation.cast<float>();
  Mesh mesh = asset.mesh;
  for (Eigen::Vector3f& vertex : mesh.vertices) vertex = turn * vertex;
  for (Eigen::Vector3f& normal : mesh.normals) normal = turn * normal;
  Json joints = Json::array(), skin = Json::array();
  const auto positions = asset.skeleton.positions();
  for (std::size_t j = 0; j < positions.size(); ++j) {
    const Eigen::Vector3d place = rotation * positions[j];
    joints.push_back({{"name", asset.skeleton.names[j]},
                      {"parent", asset.skeleton.parents[j]},
                      {"position", {place.x(), place.y(), place.z()}}});
  }
  for (std::size_t v = 0; v < asset.skin.rows(); ++v) {
    Json row = Json::array();
    for (std::size_t i = 0; i < asset.skin.row_size(v); ++i) {
      row.push_back({asset.skin.row(v)[i].joint, asset.skin.row(v)[i].weight});
    }
    skin.push_back(std::move(row));
  }
  write_obj(obj, mesh);
  std::filesystem::path rig = obj;
  rig.replace_extension(".rig.json");
  write_file_atomically(rig, Json{{"joints", std::move(joints)}, {"skin", std::move(skin)}}.dump() + "\n");
}

namespace {

template <typename Vector>
void append_line(std::string& text, const char* keyword, const Vector& numbers) {
  text += keyword;
  for (Eigen::Index k = 0; k < numbers.size(); ++k) {
    char digits[32];  // the shortest that read back as the same number
    text += ' ';
    text.append(digits, std::to_chars(digits, digits + sizeof(digits), numbers[k]).ptr);
  }
  text += '\n';
}

void append_vertices(std::string& text, const Mesh& mesh) {
  const bool transparent = std::any_of(mesh.colors.begin(), mesh.colors.end(),
                                       [](const Eigen::Vector4f& color) { return color.w() != 1.0f; });
  Eigen::VectorXf numbers(mesh.colors.empty() ? 3 : transparent ? 7 : 6);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    numbers.head<3>() = mesh.vertices[v];
    if (!mesh.colors.empty()) numbers.tail(numbers.size() - 3) = mesh.colors[v].head(numbers.size() - 3);
    append_line(text, "v", numbers);
  }
}

}  // namespace

void write_obj(const std::filesystem::path& path, const Mesh& mesh) {
  refuse_unsound_mesh(mesh, path.string());
  std::string text = "# AniGen in C++\n";
  append_vertices(text, mesh);
  for (const Eigen::Vector2f& uv : mesh.uvs) {
    // In double precision, so that turning v back on reading gives the same float.
    append_line(text, "vt", Eigen::Vector2d(uv.x(), 1.0 - static_cast<double>(uv.y())));
  }
  for (const Eigen::Vector3f& normal : mesh.normals) append_line(text, "vn", normal);
  for (const Triangle& face : mesh.faces) {
    text += 'f';
    for (const std::int32_t v : face) {
      const std::string index = std::to_string(v + std::int64_t{1});
      text += ' ' + index;
      if (!mesh.uvs.empty()) text += '/' + index;
      if (!mesh.normals.empty()) text += (mesh.uvs.empty() ? "//" : "/") + index;
    }
    text += '\n';
  }
  write_file_atomically(path, text);
}

}  // namespace anigen::io
