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

std::vector<int> own_joints(const Skeleton& skeleton, const GraftSource& source) {
  const Skeleton& own = source.rig.skeleton;
  if (own.size() > skeleton.size() || own.size() == 0) return {};
  std::map<std::string, int> by_name;
  for (std::size_t j = 0; j < own.size(); ++j) by_name[own.names[j]] = static_cast<int>(j);
  std::vector<int> joints;
  std::size_t further = own.size();
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    const auto found = by_name.find(skeleton.names[j]);
    const int parent = skeleton.parents[j];
    if (found == by_name.end()) {
      if (parent < 0) return {};
      joints.push_back(static_cast<int>(further++));
      continue;
    }
    const int joint = found->second;
    joints.push_back(joint);
    if (own.parents[at(joint)] != (parent < 0 ? -1 : joints[at(parent)])) return {};
    const Eigen::Matrix4d apart = own.bind[at(joint)] - skeleton.bind[j];
    if (!(apart.topRightCorner<3, 1>().norm() <= source.noise)) return {};
  }
  if (further != skeleton.size()) return {};  // some of the rig's joints are not there
  return joints;
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
