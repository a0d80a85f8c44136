#include "anigen/io/rigs/assimp_meshes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/io/rigs/assimp_document.h"

namespace anigen::io::assimp_import {
namespace {

using gltf_import::Notes;

constexpr std::size_t kMostInfluences = 64;  // what the stage that reads them takes

struct Weight {
  std::uint16_t entry;
  float value;
};

class MeshConverter {
 public:
  MeshConverter(const aiScene& scene, const NodeTable& nodes, gltf_import::Document& document, Notes& notes)
      : nodes_(nodes), document_(document), notes_(notes), arrays_(document), scene_(scene) {}

  /// @return the mesh's number in the document; sets `skin` to its skin or -1
  int convert(const aiMesh& mesh, const std::string& place, int& skin) {
    place_ = place;
    weights_.assign(mesh.mNumVertices, {});
    skin = mesh.mNumBones > 0 ? add_skin(mesh) : -1;
    limit_weights();
    merge_equal(mesh);
    gltf_import::MeshEntry entry;
    entry.primitives.push_back(primitive(mesh, skin >= 0));
    document_.meshes.push_back(std::move(entry));
    return static_cast<int>(document_.meshes.size()) - 1;
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const { throw InputError(document_.file, place_, problem); }

  int add_skin(const aiMesh& mesh) {
    gltf_import::Skin skin;
    skin.pointer = place_;
    std::unordered_map<int, std::size_t> entries;
    std::vector<float> inverse_binds;
    for (unsigned b = 0; b < mesh.mNumBones; ++b) {
      const aiBone& bone = *mesh.mBones[b];
      const auto node = nodes_.by_name.find(bone.mName.C_Str());
      if (node == nodes_.by_name.end()) fail(std::string("its bone '") + bone.mName.C_Str() + "' is no node");
      const auto [entry, is_new] = entries.try_emplace(node->second, skin.joints.size());
      if (is_new) {
        skin.joints.push_back(node->second);
        const Eigen::Matrix4f offset = to_matrix(bone.mOffsetMatrix).cast<float>();
        inverse_binds.insert(inverse_binds.end(), offset.data(), offset.data() + 16);  // columns, as glTF
      }
      if (skin.joints.size() > 65535) fail("more than 65,535 bones");
      for (unsigned w = 0; w < bone.mNumWeights; ++w) {
        const aiVertexWeight& weight = bone.mWeights[w];
        weights_[weight.mVertexId].push_back({static_cast<std::uint16_t>(entry->second), weight.mWeight});
      }
    }
    skin.inverse_bind_accessor = arrays_.add(inverse_binds, "MAT4", 16, place_);
    document_.skins.push_back(std::move(skin));
    return static_cast<int>(document_.skins.size()) - 1;
  }

  void limit_weights() {
    std::size_t limited = 0;
    for (std::vector<Weight>& row : weights_) {
      const auto order = [](float value) {  // what is no number first, so that the row is repaired, not cut
        return std::isnan(value) ? std::numeric_limits<float>::infinity() : value;
      };
      std::sort(row.begin(), row.end(), [&order](const Weight& a, const Weight& b) {
        return order(a.value) != order(b.value) ? order(a.value) > order(b.value) : a.entry < b.entry;
      });
      if (row.size() <= kMostInfluences) continue;
      ++limited;
      row.resize(kMostInfluences);
    }
    notes_.tally("limited_influences", "vertices kept their 64 heaviest weights", limited);
  }

  template <typename T>
  static void append(std::string& key, const T& value) {
    key.append(reinterpret_cast<const char*>(&value), sizeof value);
  }

  /// Fills first_ (which vertex of the file each kept one is) and number_ (where each went).
  void merge_equal(const aiMesh& mesh) {
    std::unordered_map<std::string, std::uint32_t> known;
    first_.clear();
    number_.clear();
    std::string key;
    for (unsigned v = 0; v < mesh.mNumVertices; ++v) {
      key.clear();
      append(key, mesh.mVertices[v]);
      if (mesh.mNormals != nullptr) append(key, mesh.mNormals[v]);
      if (mesh.mTextureCoords[0] != nullptr) append(key, mesh.mTextureCoords[0][v]);
      if (mesh.mColors[0] != nullptr) append(key, mesh.mColors[0][v]);
      for (const Weight& weight : weights_[v]) {
        append(key, weight.entry);
        append(key, weight.value);
      }
      const auto [there, is_new] = known.try_emplace(key, static_cast<std::uint32_t>(first_.size()));
      if (is_new) first_.push_back(v);
      number_.push_back(there->second);
    }
  }

  /// Three or four floats of every kept vertex.
  template <typename Get>
  std::vector<float> gather(std::size_t width, const Get& get) const {
    std::vector<float> values;
    values.reserve(first_.size() * width);
    for (const unsigned v : first_) {
      const std::array<float, 4> four = get(v);
      values.insert(values.end(), four.begin(), four.begin() + static_cast<std::ptrdiff_t>(width));
    }
    return values;
  }

  gltf_import::Primitive primitive(const aiMesh& mesh, bool is_skinned) {
    gltf_import::Primitive result;
    result.pointer = place_;
    result.material = scene_.mNumMaterials > 0 ? static_cast<int>(mesh.mMaterialIndex) : -1;
    result.has_targets = mesh.mNumAnimMeshes > 0;
    const auto attribute = [&](const std::string& name, const std::vector<float>& values, std::size_t width) {
      const int accessor = arrays_.add(values, "VEC" + std::to_string(width), width, place_);
      result.attributes.emplace_back(name, accessor);
    };
    using Four = std::array<float, 4>;
    const auto vector = [](const aiVector3D& p) { return Four{p.x, p.y, p.z, 0.0f}; };
    attribute("POSITION", gather(3, [&](unsigned v) { return vector(mesh.mVertices[v]); }), 3);
    if (mesh.mNormals != nullptr)
      attribute("NORMAL", gather(3, [&](unsigned v) { return vector(mesh.mNormals[v]); }), 3);
    if (const aiVector3D* uvs = mesh.mTextureCoords[0])  // Assimp counts from the bottom of the picture
      attribute("TEXCOORD_0", gather(2, [&](unsigned v) { return Four{uvs[v].x, 1.0f - uvs[v].y, 0.0f, 0.0f}; }), 2);
    if (const aiColor4D* colors = mesh.mColors[0]) {
      attribute("COLOR_0",
                gather(4,
                       [&](unsigned v) {
                         return Four{colors[v].r, colors[v].g, colors[v].b, colors[v].a};
                       }),
                4);
    }
    if (is_skinned) add_influences(result);
    std::vector<std::uint32_t> indices;
    for (unsigned f = 0; f < mesh.mNumFaces; ++f) {
      const aiFace& face = mesh.mFaces[f];
      if (face.mNumIndices != 3) continue;
      for (unsigned c = 0; c < 3; ++c) indices.push_back(number_[face.mIndices[c]]);
    }
    result.indices = arrays_.add(indices, "SCALAR", 1, place_);
    return result;
  }

  void add_influences(gltf_import::Primitive& result) {
    std::size_t most = 1;
    for (const unsigned v : first_) most = std::max(most, weights_[v].size());
    for (std::size_t set = 0; 4 * set < most; ++set) {
      std::vector<std::uint16_t> joints(4 * first_.size(), 0);
      std::vector<float> weights(4 * first_.size(), 0.0f);
      for (std::size_t i = 0; i < first_.size(); ++i) {
        const std::vector<Weight>& row = weights_[first_[i]];
        for (std::size_t k = 4 * set; k < std::min(row.size(), 4 * set + 4); ++k) {
          joints[4 * i + k % 4] = row[k].entry;
          weights[4 * i + k % 4] = row[k].value;
        }
      }
      const std::string number = std::to_string(set);
      result.attributes.emplace_back("JOINTS_" + number, arrays_.add(joints, "VEC4", 4, place_));
      result.attributes.emplace_back("WEIGHTS_" + number, arrays_.add(weights, "VEC4", 4, place_));
    }
  }

  const NodeTable& nodes_;
  gltf_import::Document& document_;
  Notes& notes_;
  DocumentArrays arrays_;
  const aiScene& scene_;
  std::string place_;
  std::vector<std::vector<Weight>> weights_;
  std::vector<unsigned> first_;
  std::vector<std::uint32_t> number_;
};

}  // namespace

void add_meshes(const aiScene& scene, const NodeTable& nodes, gltf_import::Document& document, Notes& notes) {
  struct Converted {
    int mesh = -1, skin = -1;
    bool shown = false;
  };
  std::vector<Converted> converted(scene.mNumMeshes);
  MeshConverter converter(scene, nodes, document, notes);
  for (std::size_t n = 0; n < nodes.node.size(); ++n) {
    for (unsigned m = 0; m < nodes.node[n]->mNumMeshes; ++m) {
      const unsigned number = nodes.node[n]->mMeshes[m];
      const aiMesh& mesh = *scene.mMeshes[number];
      Converted& one = converted[number];
      if (mesh.mNumVertices == 0 || mesh.mNumFaces == 0) {
        notes.tally("empty_primitive", "primitives without vertices or triangles were skipped");
        continue;
      }
      if (one.mesh < 0)
        one.mesh =
            converter.convert(mesh, "mesh " + std::to_string(number) + " (" + mesh.mName.C_Str() + ")", one.skin);
      // Bones alone place a skinned mesh: shown twice it would lie in the same place.
      if (one.skin >= 0 && one.shown) continue;
      one.shown = true;
      add_mesh_node(document, static_cast<int>(n), one.mesh, one.skin);
    }
  }
}

}  // namespace anigen::io::assimp_import
