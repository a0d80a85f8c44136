#include "anigen/io/rigs/assimp_scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <set>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

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
  MeshConverter(const aiScene& scene, const NodeTable& nodes, bool srgb_colors, gltf_import::Document& document,
                Notes& notes)
      : nodes_(nodes),
        srgb_colors_(srgb_colors),
        document_(document),
        notes_(notes),
        arrays_(document),
        scene_(scene) {}

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
                         return Four{linear(colors[v].r), linear(colors[v].g), linear(colors[v].b), colors[v].a};
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

  float linear(float color) const {
    if (!srgb_colors_ || !(color > 0.0f && color < 1.0f)) return color;
    const double x = static_cast<double>(color);
    return static_cast<float>(x <= 0.04045 ? x / 12.92 : std::pow((x + 0.055) / 1.055, 2.4));
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
  bool srgb_colors_;
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

void add_meshes(const aiScene& scene, const NodeTable& nodes, bool srgb_colors, gltf_import::Document& document,
                Notes& notes) {
  struct Converted {
    int mesh = -1, skin = -1;
    bool shown = false;
  };
  std::vector<Converted> converted(scene.mNumMeshes);
  MeshConverter converter(scene, nodes, srgb_colors, document, notes);
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

namespace {

constexpr std::size_t kMostKeys = 20'000'000;

Eigen::Vector3d to_vector(const aiVector3D& v) { return {v.x, v.y, v.z}; }
Eigen::Quaterniond to_quaternion(const aiQuaternion& q) { return {q.w, q.x, q.y, q.z}; }
void append_numbers(const aiVector3D& v, std::vector<float>& out) { out.insert(out.end(), {v.x, v.y, v.z}); }
void append_numbers(const aiQuaternion& q, std::vector<float>& out) { out.insert(out.end(), {q.x, q.y, q.z, q.w}); }

/// The first key at or after `time`, and how far `time` lies between it and the one before.
template <typename Key>
std::pair<unsigned, double> between(const Key* keys, unsigned count, double time) {
  const Key* after = std::lower_bound(keys, keys + count, time, [](const Key& key, double t) { return key.mTime < t; });
  const auto k = static_cast<unsigned>(after - keys);
  if (k == count) return {count - 1, 1.0};
  if (k == 0) return {0, 1.0};
  const double span = keys[k].mTime - keys[k - 1].mTime;
  return {k, span > 0.0 ? (time - keys[k - 1].mTime) / span : 1.0};
}

Eigen::Vector3d value_at(const aiVectorKey* keys, unsigned count, double time, const Eigen::Vector3d& otherwise) {
  if (count == 0) return otherwise;
  const auto [k, part] = between(keys, count, time);
  const Eigen::Vector3d value = to_vector(keys[k].mValue);
  return part < 1.0 ? Eigen::Vector3d((1.0 - part) * to_vector(keys[k - 1].mValue) + part * value) : value;
}

Eigen::Quaterniond value_at(const aiQuatKey* keys, unsigned count, double time, const Eigen::Quaterniond& otherwise) {
  if (count == 0) return otherwise;
  const auto [k, part] = between(keys, count, time);
  const Eigen::Quaterniond value = to_quaternion(keys[k].mValue).normalized();
  return part < 1.0 ? to_quaternion(keys[k - 1].mValue).normalized().slerp(part, value) : value;
}

Transform local_at(const aiNodeAnim& channel, double time, const Transform& rest) {
  Transform local;
  local.translation = value_at(channel.mPositionKeys, channel.mNumPositionKeys, time, rest.translation);
  local.rotation = value_at(channel.mRotationKeys, channel.mNumRotationKeys, time, rest.rotation);
  local.scale = value_at(channel.mScalingKeys, channel.mNumScalingKeys, time, rest.scale);
  return local;
}

class Converter {
 public:
  Converter(const NodeTable& nodes, gltf_import::Document& document)
      : nodes_(nodes), document_(document), arrays_(document) {}

  void convert(const aiAnimation& animation) {
    place_ = std::string("animation ") + animation.mName.C_Str();
    per_second_ = animation.mTicksPerSecond > 0.0 ? animation.mTicksPerSecond : 25.0;  // Assimp's custom
    channels_.clear();
    first_ = 0.0;
    for (unsigned c = 0; c < animation.mNumChannels; ++c) {
      const aiNodeAnim& channel = *animation.mChannels[c];
      channels_.emplace(channel.mNodeName.C_Str(), &channel);
      start(channel.mPositionKeys, channel.mNumPositionKeys);
      start(channel.mRotationKeys, channel.mNumRotationKeys);
      start(channel.mScalingKeys, channel.mNumScalingKeys);
    }
    gltf_import::AnimationEntry entry;
    entry.name = animation.mName.C_Str();
    for (std::size_t n = 0; n < nodes_.node.size(); ++n) {
      if (document_.nodes[n].parent >= 0) add_node(static_cast<int>(n), entry);  // the root's transform is ours
    }
    if (!entry.channels.empty()) document_.animations.push_back(std::move(entry));
  }

 private:
  template <typename Key>
  void start(const Key* keys, unsigned count) {
    keys_ += count;
    if (keys_ > kMostKeys)
      throw InputError(document_.file, place_, "the animations have more than " + std::to_string(kMostKeys) + " keys");
    for (unsigned k = 0; k < count; ++k) {
      if (std::isfinite(keys[k].mTime)) first_ = std::min(first_, keys[k].mTime);
    }
  }

  const aiNodeAnim* channel(const aiNode& node) const {
    const auto found = channels_.find(node.mName.C_Str());
    return found == channels_.end() ? nullptr : found->second;
  }

  float seconds(double ticks) const { return static_cast<float>((ticks - first_) / per_second_); }

  void add_node(int node, gltf_import::AnimationEntry& entry) {
    std::vector<const aiNode*> chain = nodes_.chain[at(node)];
    // Keys of the model itself are those of its whole transform, which then are not repeated by its helper nodes.
    if (channel(*chain.back()) != nullptr) {
      const std::string own = std::string(chain.back()->mName.C_Str()) + "_$AssimpFbx$_";
      chain.erase(std::remove_if(chain.begin(), chain.end(),
                                 [&own](const aiNode* one) {
                                   return std::string_view(one->mName.C_Str()).substr(0, own.size()) == own;
                                 }),
                  chain.end());
    }
    const bool moves =
        std::any_of(chain.begin(), chain.end(), [&](const aiNode* one) { return channel(*one) != nullptr; });
    if (!moves) return;
    if (chain.size() == 1)
      add_plain(node, *channel(*chain.front()), entry);
    else
      add_product(node, chain, entry);
  }

  void add_track(int node, ChannelPath path, const std::vector<float>& times, const std::vector<float>& values,
                 gltf_import::AnimationEntry& entry) {
    if (times.empty()) return;
    written_ += times.size();  // a channel is repeated for every node of its name
    if (written_ > 3 * kMostKeys) {
      throw InputError(document_.file, place_,
                       "the animations have more than " + std::to_string(3 * kMostKeys) + " keys on all their nodes");
    }
    gltf_import::AnimationChannel channel;
    channel.pointer = place_;
    channel.node = node;
    channel.path = path;
    channel.input = arrays_.add(times, "SCALAR", 1, place_);
    const bool is_rotation = path == ChannelPath::kRotation;
    channel.output = arrays_.add(values, is_rotation ? "VEC4" : "VEC3", is_rotation ? 4 : 3, place_);
    entry.channels.push_back(std::move(channel));
  }

  void add_plain(int node, const aiNodeAnim& channel, gltf_import::AnimationEntry& entry) {
    const auto track = [&](ChannelPath path, const auto* keys, unsigned count) {
      std::vector<float> times, values;
      for (unsigned k = 0; k < count; ++k) {
        times.push_back(seconds(keys[k].mTime));
        append_numbers(keys[k].mValue, values);
      }
      add_track(node, path, times, values, entry);
    };
    track(ChannelPath::kTranslation, channel.mPositionKeys, channel.mNumPositionKeys);
    track(ChannelPath::kRotation, channel.mRotationKeys, channel.mNumRotationKeys);
    track(ChannelPath::kScale, channel.mScalingKeys, channel.mNumScalingKeys);
  }

  void add_product(int node, const std::vector<const aiNode*>& chain, gltf_import::AnimationEntry& entry) {
    struct Link {
      const aiNodeAnim* channel;
      Transform rest;
      Eigen::Matrix4d matrix;
    };
    std::vector<Link> links;
    std::set<double> ticks;
    for (const aiNode* one : chain) {
      const Eigen::Matrix4d matrix = to_matrix(one->mTransformation);
      links.push_back({channel(*one), decompose(matrix), matrix});
      if (links.back().channel == nullptr) continue;
      const aiNodeAnim& keys = *links.back().channel;
      for (unsigned k = 0; k < keys.mNumPositionKeys; ++k) ticks.insert(keys.mPositionKeys[k].mTime);
      for (unsigned k = 0; k < keys.mNumRotationKeys; ++k) ticks.insert(keys.mRotationKeys[k].mTime);
      for (unsigned k = 0; k < keys.mNumScalingKeys; ++k) ticks.insert(keys.mScalingKeys[k].mTime);
    }
    std::vector<float> times, translations, rotations, scales;
    for (const double tick : ticks) {
      if (!std::isfinite(tick)) continue;
      Eigen::Matrix4d product = Eigen::Matrix4d::Identity();
      for (const Link& link : links) {
        product = Eigen::Matrix4d(
            product * (link.channel == nullptr ? link.matrix : local_at(*link.channel, tick, link.rest).matrix()));
      }
      if (!product.allFinite()) continue;
      const Transform local = decompose(product);
      times.push_back(seconds(tick));
      for (const double x : local.translation) translations.push_back(static_cast<float>(x));
      for (const double x : local.rotation.coeffs()) rotations.push_back(static_cast<float>(x));
      for (const double x : local.scale) scales.push_back(static_cast<float>(x));
    }
    add_track(node, ChannelPath::kTranslation, times, translations, entry);
    add_track(node, ChannelPath::kRotation, times, rotations, entry);
    add_track(node, ChannelPath::kScale, times, scales, entry);
  }

  const NodeTable& nodes_;
  gltf_import::Document& document_;
  DocumentArrays arrays_;
  std::string place_;
  double per_second_ = 25.0, first_ = 0.0;
  std::size_t keys_ = 0, written_ = 0;
  std::unordered_map<std::string, const aiNodeAnim*> channels_;
};

}  // namespace

void add_animations(const aiScene& scene, const NodeTable& nodes, gltf_import::Document& document) {
  Converter converter(nodes, document);
  for (unsigned a = 0; a < scene.mNumAnimations; ++a) converter.convert(*scene.mAnimations[a]);
}

}  // namespace anigen::io::assimp_import
