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
  return hash;
}

}  // namespace anigen::eval
