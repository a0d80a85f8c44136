#include "anigen/mesh_health/carry.h"

#include <algorithm>
#include <map>
#include <memory>
#include <set>
#include <tuple>
#include <utility>

#include "anigen/core/numeric.h"
#include "anigen/geometry/correspondence.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/mesh_health/weld.h"
#include "anigen/render/surface_color.h"

namespace anigen::mesh_health {

namespace {

Triangle sorted_corners(Triangle face) {
  std::sort(face.begin(), face.end());
  return face;
}

bool equal_attributes(const Asset& asset, std::size_t a, std::size_t b) {
  const Mesh& mesh = asset.mesh;
  if (!mesh.uvs.empty() && mesh.uvs[a] != mesh.uvs[b]) return false;
  if (!mesh.normals.empty() && mesh.normals[a] != mesh.normals[b]) return false;
  if (!mesh.colors.empty() && mesh.colors[a] != mesh.colors[b]) return false;
  if (asset.skin.rows() == 0) return true;
  const auto same = [](const Influence& x, const Influence& y) { return x.joint == y.joint && x.weight == y.weight; };
  const Influence *row_a = asset.skin.row(a), *row_b = asset.skin.row(b);
  return std::equal(row_a, row_a + asset.skin.row_size(a), row_b, row_b + asset.skin.row_size(b), same);
}

/// For each vertex the first at its place with the same attributes.
std::vector<std::int32_t> first_alike(const Asset& asset, const WeldedMesh& welded) {
  std::vector<std::vector<std::int32_t>> kinds(welded.places.size());
  std::vector<std::int32_t> result(asset.mesh.vertices.size());
  for (std::size_t v = 0; v < result.size(); ++v) {
    auto& known = kinds[at(welded.of_vertex[v])];
    const auto alike =
        std::find_if(known.begin(), known.end(), [&](std::int32_t u) { return equal_attributes(asset, at(u), v); });
    if (alike != known.end()) {
      result[v] = *alike;
    } else {
      result[v] = static_cast<std::int32_t>(v);
      known.push_back(result[v]);
    }
  }
  return result;
}

/// Parts of the original that the faces of a repaired mesh continue.
struct Sources {
  std::vector<std::int32_t> face;  ///< [F] whose material it has; -1: none
  std::vector<Triangle> corners;   ///< [F] vertices whose attributes they have; -1: none
  std::vector<char> reversed;      ///< [F] not 0: it is the original face the other way round
};

/// The faces that are as they were.
Sources unchanged_faces(const Asset& from, const Repaired& repaired, const WeldedMesh& welded) {
  const std::vector<Triangle>& faces = repaired.mesh.faces;
  const std::vector<std::int32_t> alike = first_alike(from, welded);
  std::map<Triangle, std::size_t> originals;
  for (std::size_t f = 0; f < welded.faces.size(); ++f) originals[sorted_corners(welded.faces[f])] = f;
  Sources sources{std::vector<std::int32_t>(faces.size(), -1), std::vector<Triangle>(faces.size(), {-1, -1, -1}),
                  std::vector<char>(faces.size(), 0)};
  for (std::size_t f = 0; f < faces.size(); ++f) {
    Triangle places{};
    for (std::size_t k = 0; k < 3; ++k) places[k] = repaired.place[at(faces[f][k])];
    const auto found = originals.find(sorted_corners(places));
    if (found == originals.end()) continue;
    const std::size_t in_file = welded.face_of_file[found->second];
    sources.face[f] = static_cast<std::int32_t>(in_file);
    std::array<std::size_t, 3> corner{};
    for (std::size_t k = 0; k < 3; ++k) {
      const Triangle& old = welded.faces[found->second];
      corner[k] = static_cast<std::size_t>(std::find(old.begin(), old.end(), places[k]) - old.begin());
      sources.corners[f][k] = alike[at(from.mesh.faces[in_file][corner[k]])];
    }
    sources.reversed[f] = corner[1] != (corner[0] + 1) % 3;
  }
  return sources;
}

/// New faces take what their neighbours have at the vertices that they share, one ring after another.
void continue_into_new_faces(const Mesh& mesh, Sources& sources) {
  const MeshEdges edges(mesh.faces, mesh.vertices.size());
  std::map<std::int32_t, std::int32_t> at_vertex;  // of faces that were there
  std::vector<std::size_t> open;
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    if (sources.face[f] < 0) {
      open.push_back(f);
      continue;
    }
    for (std::size_t k = 0; k < 3; ++k) at_vertex.try_emplace(mesh.faces[f][k], sources.corners[f][k]);
  }
  const auto continue_face = [&](std::size_t f) {
    for (std::size_t side = 0; side < 3; ++side) {
      for (const std::int32_t other : edges.faces(at(edges.of_face(f, side)))) {
        if (sources.face[at(other)] < 0) continue;
        sources.face[f] = sources.face[at(other)];
        for (std::size_t k = 0; k < 3; ++k) {
          const auto& its = mesh.faces[at(other)];
          const auto shared = std::find(its.begin(), its.end(), mesh.faces[f][k]);
          const auto known = at_vertex.find(mesh.faces[f][k]);
          if (shared != its.end()) {
            sources.corners[f][k] = sources.corners[at(other)][static_cast<std::size_t>(shared - its.begin())];
          } else if (known != at_vertex.end()) {
            sources.corners[f][k] = known->second;
          }
        }
        return true;
      }
    }
    return false;
  };
  for (std::size_t before = open.size() + 1; open.size() < before;) {
    before = open.size();
    open.erase(std::remove_if(open.begin(), open.end(), continue_face), open.end());
  }
}

template <typename Vector>
Vector interpolated(const std::vector<Vector>& values, const std::vector<Triangle>& faces,
                    const geometry::SurfacePoint& place) {
  Vector sum = Vector::Zero();
  for (std::size_t k = 0; k < 3; ++k)
    sum += static_cast<float>(place.barycentric[static_cast<Eigen::Index>(k)]) * values[at(faces[at(place.face)][k])];
  return sum;
}

/// Appends vertices with the attributes of one of the original mesh, or of a place on it.
class VertexWriter {
 public:
  VertexWriter(const Asset& from, Asset& to) : from_(from), to_(to) {}

  void add(const Eigen::Vector3f& position, std::int32_t source, bool reversed) {
    const Mesh& mesh = from_.mesh;
    to_.mesh.vertices.push_back(position);
    if (!mesh.uvs.empty()) to_.mesh.uvs.push_back(mesh.uvs[at(source)]);
    if (!mesh.colors.empty()) to_.mesh.colors.push_back(mesh.colors[at(source)]);
    if (!mesh.normals.empty()) {
      to_.mesh.normals.push_back(mesh.normals[at(source)]);
      if (reversed) to_.mesh.normals.back() *= -1.0f;
    }
    if (from_.skin.rows() > 0) to_.skin.append_copy(from_.skin, at(source));
  }

  /// @param normal of the new surface
  void add(const Eigen::Vector3f& position, const geometry::SurfacePoint& place, const Eigen::Vector3f& normal) {
    const Mesh& mesh = from_.mesh;
    to_.mesh.vertices.push_back(position);
    if (!mesh.uvs.empty()) to_.mesh.uvs.push_back(interpolated(mesh.uvs, mesh.faces, place));
    if (!mesh.colors.empty()) to_.mesh.colors.push_back(interpolated(mesh.colors, mesh.faces, place));
    if (!mesh.normals.empty()) to_.mesh.normals.push_back(normal);
    if (from_.skin.rows() > 0) to_.skin.append_copy(geometry::interpolate_skin(from_.skin, mesh.faces, {place}), 0);
  }

 private:
  const Asset& from_;
  Asset& to_;
};

/// Everything but mesh and weights.
Asset without_mesh(const Asset& from) {
  Asset asset;
  asset.name = from.name;
  asset.skeleton = from.skeleton;
  asset.materials = from.materials;
  asset.images = from.images;
  asset.animations = from.animations;
  return asset;
}

std::set<std::int32_t> materials_in_use(const Asset& asset) {
  std::set<std::int32_t> used(asset.mesh.face_materials.begin(), asset.mesh.face_materials.end());
  if (used.empty()) used.insert(-1);
  return used;
}

/// Base colour of an asset at places on its surface.
class BaseColor {
 public:
  explicit BaseColor(const Asset& asset) : asset_(asset) {
    for (const std::int32_t material : materials_in_use(asset)) {
      const int image = material < 0 ? -1 : asset.materials[at(material)].image;
      if (image < 0 || asset.mesh.uvs.empty()) continue;
      textures_[material] = std::make_unique<render::Texture>(asset.images[at(image)], asset.name);
    }
  }

  Eigen::Vector4f at_place(const geometry::SurfacePoint& place) const {
    const Mesh& mesh = asset_.mesh;
    const std::int32_t material = mesh.face_materials.empty() ? -1 : mesh.face_materials[at(place.face)];
    Eigen::Vector4f color = Eigen::Vector4f::Ones();
    if (material >= 0) color = asset_.materials[at(material)].base_color;
    if (!mesh.colors.empty()) color = color.cwiseProduct(interpolated(mesh.colors, mesh.faces, place));
    const auto texture = textures_.find(material);
    if (texture != textures_.end()) {
      const Eigen::Vector3f texel = texture->second->lookup(interpolated(mesh.uvs, mesh.faces, place));
      color.head<3>() = color.head<3>().cwiseProduct(texel);
    }
    return color.cwiseMax(0.0f).cwiseMin(1.0f);
  }

  bool has_textures() const { return !textures_.empty(); }

 private:
  const Asset& asset_;
  std::map<std::int32_t, std::unique_ptr<render::Texture>> textures_;
};

}  // namespace

CarriedAsset carry_to_repaired(const Asset& from, const Repaired& repaired, const RepairOptions& options) {
  const WeldedMesh welded = weld(from.mesh, merge_distance(from.mesh, options));
  Sources sources = unchanged_faces(from, repaired, welded);
  continue_into_new_faces(repaired.mesh, sources);
  const std::vector<Eigen::Vector3f> normals = angle_weighted_normals(repaired.mesh.vertices, repaired.mesh.faces);
  std::unique_ptr<geometry::NearestSurface> surface;
  CarriedAsset result{without_mesh(from), {}};
  Asset& asset = result.asset;
  VertexWriter writer(from, asset);
  std::map<std::tuple<std::int32_t, std::int32_t, bool>, std::int32_t> numbers;
  for (std::size_t f = 0; f < repaired.mesh.faces.size(); ++f) {
    Triangle face{};
    for (std::size_t k = 0; k < 3; ++k) {
      const std::int32_t vertex = repaired.mesh.faces[f][k], source = sources.corners[f][k];
      const bool reversed = sources.reversed[f] != 0 && !from.mesh.normals.empty();
      const auto [number, is_new] =
          numbers.try_emplace({vertex, source, reversed}, static_cast<std::int32_t>(asset.mesh.vertices.size()));
      face[k] = number->second;
      if (!is_new) continue;
      const Eigen::Vector3f& position = repaired.mesh.vertices[at(vertex)];
      if (source >= 0) {
        writer.add(position, source, reversed);
      } else {
        if (!surface) surface = std::make_unique<geometry::NearestSurface>(from.mesh);
        writer.add(position, surface->query(position.cast<double>()).at, normals[at(vertex)]);
      }
    }
    asset.mesh.faces.push_back(face);
    if (from.mesh.face_materials.empty()) continue;
    const std::int32_t source = sources.face[f];
    asset.mesh.face_materials.push_back(source < 0 ? -1 : from.mesh.face_materials[at(source)]);
  }
  return result;
}

CarriedAsset carry_to_new_surface(const Asset& from, Mesh surface) {
  const std::vector<geometry::SurfacePoint> places = geometry::matching_places(from.mesh, surface);
  CarriedAsset result{without_mesh(from), {}};
  Asset& asset = result.asset;
  if (from.skin.rows() > 0) asset.skin = geometry::interpolate_skin(from.skin, from.mesh.faces, places);
  const BaseColor color(from);
  const std::set<std::int32_t> materials = materials_in_use(from);
  if (color.has_textures() || !from.mesh.colors.empty() || materials.size() > 1) {
    for (const geometry::SurfacePoint& place : places) surface.colors.push_back(color.at_place(place));
    Material plain;
    plain.name = "surface";
    asset.materials = {plain};
    surface.face_materials.assign(surface.faces.size(), 0);
    if (color.has_textures()) result.lost.emplace_back("textures (their colours are now those of the vertices)");
    if (materials.size() > 1) result.lost.emplace_back("its " + std::to_string(materials.size()) + " materials");
  } else {
    surface.face_materials.assign(surface.faces.size(), *materials.begin());
    for (Material& material : asset.materials) material.image = -1;
  }
  asset.images.clear();
  if (!from.mesh.uvs.empty()) result.lost.emplace_back("texture coordinates");
  if (!from.mesh.normals.empty()) surface.normals = angle_weighted_normals(surface.vertices, surface.faces);
  asset.mesh = std::move(surface);
  return result;
}

}  // namespace anigen::mesh_health
