#include <algorithm>
#include <array>
#include <cmath>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/io/meshes/mesh_check.h"
#include "anigen/io/meshes/ply_header.h"
#include "anigen/io/meshes/ply_values.h"
#include "anigen/io/ply.h"

namespace anigen::io {
namespace {

constexpr std::uintmax_t kMostPlyBytes = std::uintmax_t{4} << 30;

// Where a vertex property goes; the numbers of one vertex are gathered in this order.
enum Slot { kX, kY, kZ, kNx, kNy, kNz, kRed, kGreen, kBlue, kAlpha, kU, kV, kSlots, kNone };

Slot slot_named(const std::string& name) {
  static constexpr struct {
    const char* name;
    Slot slot;
  } kNames[] = {{"x", kX},
                {"y", kY},
                {"z", kZ},
                {"nx", kNx},
                {"ny", kNy},
                {"nz", kNz},
                {"red", kRed},
                {"green", kGreen},
                {"blue", kBlue},
                {"alpha", kAlpha},
                {"r", kRed},
                {"g", kGreen},
                {"b", kBlue},
                {"a", kAlpha},
                {"diffuse_red", kRed},
                {"diffuse_green", kGreen},
                {"diffuse_blue", kBlue},
                {"s", kU},
                {"t", kV},
                {"u", kU},
                {"v", kV},
                {"texture_u", kU},
                {"texture_v", kV}};
  for (const auto& known : kNames) {
    if (name == known.name) return known.slot;
  }
  return kNone;
}

void skip_list(PlyValues& values, const PlyProperty& property) {
  const std::size_t length = values.next_length(property);
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
          skip_list(values, property);
        } else {
          row[slots_[p]] = values.next(property.type) * scale_[slots_[p]];
        }
      }
      mesh.vertices.push_back(finite3(values, row, kX));
      if (normals) mesh.normals.push_back(unit_normal(finite3(values, row, kNx)));
      if (uvs) mesh.uvs.push_back({finite(values, row[kU]), finite(values, 1.0 - row[kV])});
      if (colors) {
        Eigen::Vector4f color;
        for (int k = 0; k < 4; ++k) {
          color[k] = std::clamp(finite(values, row[static_cast<std::size_t>(kRed + k)]), 0.0f, 1.0f);
        }
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
      if (property == polygon) {
        read_polygon(values, *property, vertices, mesh);
      } else if (property->is_list) {
        skip_list(values, *property);
      } else {
        values.next(property->type);
      }
    }
  }
}

void skip_element(PlyValues& values, const PlyElement& element) {
  if (element.properties.empty()) return;
  for (std::uint64_t row = 0; row < element.count; ++row) {
    for (const PlyProperty& property : element.properties) {
      if (property.is_list)
        skip_list(values, property);
      else
        values.next(property.type);
    }
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
  const PlyHeader header = parse_ply_header(bytes, file);
  const PlyElement* vertices = element_named(header, "vertex");
  const PlyElement* faces = element_named(header, "face");
  if (vertices == nullptr || vertices->count == 0) throw InputError(file, "", "no vertices");
  if (faces == nullptr && element_named(header, "tristrips") != nullptr) {
    throw NotSupportedError(file, "", "triangle strips in PLY");
  }
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

}  // namespace anigen::io
