#include "anigen/rig/binding/binding.h"

#include <array>
#include <utility>

#include "anigen/core/error.h"

namespace anigen::rig {
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

}  // namespace anigen::rig
