#include "anigen/io/rigs/assimp_animations.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/io/rigs/assimp_document.h"

namespace anigen::io::assimp_import {
namespace {

constexpr std::size_t kMostKeys = 20'000'000;

Eigen::Vector3d to_vector(const aiVector3D& v) { return {v.x, v.y, v.z}; }
Eigen::Quaterniond to_quaternion(const aiQuaternion& q) { return {q.w, q.x, q.y, q.z}; }

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
    std::vector<const aiNode*> chain = nodes_.chain[static_cast<std::size_t>(node)];
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
    const auto vectors = [&](ChannelPath path, const aiVectorKey* keys, unsigned count) {
      std::vector<float> times, values;
      for (unsigned k = 0; k < count; ++k) {
        times.push_back(seconds(keys[k].mTime));
        values.insert(values.end(), {keys[k].mValue.x, keys[k].mValue.y, keys[k].mValue.z});
      }
      add_track(node, path, times, values, entry);
    };
    vectors(ChannelPath::kTranslation, channel.mPositionKeys, channel.mNumPositionKeys);
    std::vector<float> times, values;
    for (unsigned k = 0; k < channel.mNumRotationKeys; ++k) {
      const aiQuaternion& q = channel.mRotationKeys[k].mValue;
      times.push_back(seconds(channel.mRotationKeys[k].mTime));
      values.insert(values.end(), {q.x, q.y, q.z, q.w});
    }
    add_track(node, ChannelPath::kRotation, times, values, entry);
    vectors(ChannelPath::kScale, channel.mScalingKeys, channel.mNumScalingKeys);
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
