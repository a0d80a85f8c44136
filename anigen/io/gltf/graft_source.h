#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/io/gltf/container.h"
#include "anigen/io/gltf/document.h"
#include "anigen/io/gltf/graft.h"
#include "anigen/io/gltf/mesh.h"
#include "anigen/io/gltf/rig.h"

namespace anigen::io::gltf_import {

/// A glTF file and what the importer makes of it, with the text of its JSON.
struct GraftSource {
  /// @throws InputError, NotSupportedError as read_gltf()
  explicit GraftSource(const std::filesystem::path& path);

  ImportOptions options;
  Container container;
  Document document;
  std::vector<char> moving;  // per node
  Rig rig;
  std::vector<SkinBinding> bindings;
  MergedMesh merged;
  double noise = 0.0;  // distance that rounding explains
};

/// @throws InputError naming the file when skeleton or weights are not sound or do not fit it; NotSupportedError for
/// more joints than glTF has
void check_graft(const GraftSource& source, const Skeleton& skeleton, const SkinWeights& skin,
                 const GraftOptions& options);

/// Joint of a file's own skeleton per joint of another one that holds it, in whatever order; further joints get the
/// numbers behind. Empty where it does not hold it, and `why_not` says why.
/// @param names [J] by which the file's joints are known @param near distance that rounding explains
std::vector<int> own_joints(const Skeleton& own, const Skeleton& skeleton, const std::vector<std::string>& names,
                            double near, std::string& why_not);

/// The rig's own skeleton with the further joints of another one behind it, in the places that they have there.
/// @param own as own_joints() has it
Skeleton with_further_joints(const Skeleton& rig, const Skeleton& skeleton, const std::vector<int>& own);

}  // namespace anigen::io::gltf_import
