#include "anigen/io/gltf/graft_source.h"

#include <Eigen/Core>
#include <cmath>
#include <map>
#include <string>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/gltf/export.h"

namespace anigen::io::gltf_import {

GraftSource::GraftSource(const std::filesystem::path& path) {
  options.require_rig = false;
  read_container(path, options, container, true);
  Notes repairs;  // read_gltf() tells them
  document = parse_document(container, options, repairs);
  moving = moving_nodes(document, repairs);
  rig = build_rig(document, moving, options, repairs);
  bindings = bind_skins(document, rig, repairs);
  merged = merge_meshes(document, rig, bindings, options, repairs);
  noise = 1e-5 * bounding_box(merged.mesh.vertices).diagonal();
}

void check_graft(const GraftSource& source, const Skeleton& skeleton, const SkinWeights& skin,
                 const GraftOptions& options) {
  const std::string& file = source.document.file;
  if (options.influences == 0) throw InputError(file, "", "influences per vertex must be at least 1");
  Asset bare;
  bare.skeleton = skeleton;
  const std::vector<std::string> findings = validate(bare, 1, false);
  if (!findings.empty()) throw InputError(file, "", "the skeleton for it is not sound: " + findings.front());
  if (skeleton.size() > kMostSkinJoints) throw NotSupportedError(file, "", "more than 65536 joints in glTF");
  const std::size_t vertices = source.merged.mesh.vertices.size();
  if (!options.names.empty() && options.names.size() != skeleton.size())
    throw InputError(file, "", "there are as many names as joints, or none");
  if (skin.rows() != vertices) {
    throw InputError(file, "",
                     "there are " + std::to_string(skin.rows()) + " rows of weights for its " +
                         std::to_string(vertices) + " vertices");
  }
  for (std::size_t v = 0; v < vertices; ++v) {
    const std::string row = "the weights of vertex " + std::to_string(v);
    if (skin.row_size(v) == 0) throw InputError(file, "", row + " are missing");
    for (std::size_t i = 0; i < skin.row_size(v); ++i) {
      const Influence& influence = skin.row(v)[i];
      if (influence.joint < 0 || at(influence.joint) >= skeleton.size())
        throw InputError(file, "", row + " name joint " + std::to_string(influence.joint) + ", which there is not");
      if (!(influence.weight > 0.0f) || !std::isfinite(influence.weight))
        throw InputError(file, "", row + " are not all finite and above 0");
    }
  }
}

std::vector<int> own_joints(const Skeleton& own, const Skeleton& skeleton, const std::vector<std::string>& names,
                            double near, std::string& why_not) {
  std::map<std::string, int> by_name;
  for (std::size_t j = 0; j < own.size() && own.names.size() == own.size(); ++j)
    by_name[own.names[j]] = static_cast<int>(j);
  const std::vector<Eigen::Vector3d> places = own.positions(), wanted = skeleton.positions();
  std::vector<int> numbers;
  std::size_t further = own.size();
  const auto refused = [&why_not](const char* why) {
    why_not = why;
    return std::vector<int>();
  };
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    const auto found = by_name.find(names[j]);
    const int parent = skeleton.parents[j], above = parent < 0 ? -1 : numbers[at(parent)];
    if (found == by_name.end()) {
      if (parent < 0) return refused("joints of the file are not there");
      numbers.push_back(static_cast<int>(further++));
      continue;
    }
    const std::size_t joint = at(found->second);
    numbers.push_back(found->second);
    if (own.parents[joint] != above) return refused("joints of the file hang on others");
    if (!((places[joint] - wanted[j]).norm() <= near)) return refused("joints of the file were moved");
  }
  return further == skeleton.size() ? numbers : refused("joints of the file are not there");
}

Skeleton with_further_joints(const Skeleton& rig, const Skeleton& skeleton, const std::vector<int>& own) {
  Skeleton result = rig;
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    if (at(own[j]) < rig.size()) continue;
    const int parent = own[at(skeleton.parents[j])];
    result.names.push_back(skeleton.names[j]);
    result.parents.push_back(parent);
    result.bind.push_back(skeleton.bind[j]);
    result.rest.push_back(decompose(result.bind[at(parent)].inverse() * skeleton.bind[j]));
  }
  return result;
}

}  // namespace anigen::io::gltf_import
