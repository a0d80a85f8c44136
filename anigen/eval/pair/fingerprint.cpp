#include "anigen/eval/pair/fingerprint.h"

#include <string_view>

#include "anigen/core/random.h"

namespace anigen::eval {
namespace {

template <typename T>
std::uint64_t hash_of(const std::vector<T>& values, std::uint64_t seed) {
  const std::uint64_t counted = stable_hash(std::to_string(values.size()), seed);
  if (values.empty()) return counted;
  return stable_hash({reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)}, counted);
}

std::uint64_t hash_of(const io::RigClips& clips, std::uint64_t hash) {
  const auto add = [&hash](const double* values, Eigen::Index count) {
    hash = hash_of(std::vector<double>(values, values + count), hash);
  };
  for (std::size_t j = 0; j < clips.skeleton.size(); ++j) {
    add(clips.skeleton.bind[j].data(), 16);
    add(clips.skeleton.rest[j].matrix().eval().data(), 16);
  }
  for (const Animation& animation : clips.animations) {
    hash = stable_hash(animation.name, hash);
    for (const Channel& channel : animation.channels) {
      const std::vector<int> kind = {channel.joint, static_cast<int>(channel.path),
                                     static_cast<int>(channel.interpolation)};
      hash = hash_of(channel.values, hash_of(channel.times, hash_of(kind, hash)));
    }
  }
  return hash;
}

}  // namespace

std::uint64_t fingerprint(const io::RiggedShape& shape) {
  std::uint64_t hash = hash_of(shape.mesh.vertices, 1);
  hash = hash_of(shape.mesh.faces, hash);
  hash = hash_of(shape.mesh.colors, hash);
  hash = hash_of(shape.mesh.uvs, hash);
  hash = hash_of(shape.mesh.face_materials, hash);
  for (const Material& material : shape.materials) {
    const Eigen::Vector4f& c = material.base_color;
    hash = hash_of(std::vector<float>{c.x(), c.y(), c.z(), c.w(), static_cast<float>(material.image)}, hash);
  }
  for (const EncodedImage& image : shape.images) hash = hash_of(image.bytes, hash);
  hash = hash_of(shape.joints.positions, hash);
  hash = hash_of(shape.joints.parents, hash);
  hash = hash_of(shape.skin.offsets, hash);
  for (const Influence& influence : shape.skin.influences) {
    // Field by field: the bytes between fields, if any, are not ours.
    hash = hash * 1099511628211ULL ^ static_cast<std::uint64_t>(influence.joint);
    hash = stable_hash({reinterpret_cast<const char*>(&influence.weight), sizeof influence.weight}, hash);
  }
  return shape.clips == nullptr ? hash : hash_of(*shape.clips, hash);
}

}  // namespace anigen::eval
