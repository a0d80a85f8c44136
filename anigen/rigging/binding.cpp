#include "anigen/rigging/binding.h"

#include <algorithm>
#include <array>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/geometry/bones.h"
#include "anigen/rigging/surface.h"

namespace anigen::rigging {

StrongestInfluences::StrongestInfluences(std::size_t rows, std::size_t joints, std::size_t most)
    : most_(most == 0 ? joints : std::min(most, joints)), counts_(rows, 0), kept_(rows * most_) {}

void StrongestInfluences::offer(std::size_t row, std::size_t joint, float weight) {
  if (!(weight > 0.0F)) return;
  const Influence offered{static_cast<std::int32_t>(joint), weight};
  const auto stronger = [](const Influence& a, const Influence& b) {
    return a.weight != b.weight ? a.weight > b.weight : a.joint < b.joint;
  };
  Influence* first = kept_.data() + row * most_;
  std::uint32_t& count = counts_[row];
  if (count == most_) {
    if (!stronger(offered, first[count - 1])) return;
  } else {
    ++count;
  }
  Influence* place = first + count - 1;
  for (; place != first && stronger(offered, place[-1]); --place) *place = place[-1];
  *place = offered;
}

SkinWeights StrongestInfluences::rows() const {
  SkinWeights skin;
  skin.offsets.reserve(counts_.size() + 1);
  for (std::size_t row = 0; row < counts_.size(); ++row) {
    const Influence* first = kept_.data() + row * most_;
    skin.append_row({first, first + counts_[row]});
  }
  return skin;
}

SkinWeights bind_to_nearest_bone(const Mesh& mesh, const Skeleton& skeleton) {
  require_joints(skeleton);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    if (mesh.vertices[v].allFinite()) continue;
    throw InputError("", "mesh.vertices[" + std::to_string(v) + "]", "the position is not finite");
  }
  std::vector<Eigen::Vector3f> joints;
  for (const Eigen::Vector3d& joint : skeleton.positions()) joints.push_back(joint.cast<float>());
  const auto segments = geometry::bone_segments(joints, skeleton.parents);
  SkinWeights skin;
  for (const std::size_t joint : geometry::nearest_moving_joints(mesh.vertices, segments)) {
    skin.append_row({{static_cast<std::int32_t>(joint), 1.0F}});
  }
  return skin;
}

namespace {

constexpr std::array<std::pair<SkinBinding, const char*>, 3> kBindingWords = {
    {{SkinBinding::kNearest, "nearest"}, {SkinBinding::kGeodesicVoxels, "geovoxel"}, {SkinBinding::kHeat, "heat"}}};

}  // namespace

std::string to_string(SkinBinding binding) {
  for (const auto& [known, word] : kBindingWords) {
    if (known == binding) return word;
  }
  throw Error("an unknown skin binding");
}

SkinBinding parse_skin_binding(const std::string& word) {
  std::string words;
  for (const auto& [binding, known] : kBindingWords) {
    if (word == known) return binding;
    words += words.empty() ? known : std::string(", ") + known;
  }
  throw InputError("", "binding", "\"" + word + "\" is none of " + words);
}

SkinWeights bind(SkinBinding binding, const Mesh& mesh, const Skeleton& skeleton, const BindingOptions& options) {
  switch (binding) {
    case SkinBinding::kNearest:
      return bind_to_nearest_bone(mesh, skeleton);
    case SkinBinding::kGeodesicVoxels:
      return bind_by_geodesic_voxels(mesh, skeleton, options.geodesic);
    case SkinBinding::kHeat:
      return bind_by_heat(mesh, skeleton, options.heat);
  }
  throw Error("an unknown skin binding");
}

}  // namespace anigen::rigging
