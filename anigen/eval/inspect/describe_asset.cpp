#include <algorithm>
#include <map>

#include "anigen/asset/validate.h"
#include "anigen/eval/inspect/inspect.h"

namespace anigen::eval {
namespace {

Json corner(const Eigen::Vector3d& p) { return {p.x(), p.y(), p.z()}; }

/// Longest chain of joints from the root, counted in joints.
std::size_t depth(const std::vector<int>& parents) {
  std::vector<std::size_t> depths(parents.size(), 1);
  std::size_t deepest = 0;
  for (std::size_t j = 0; j < parents.size(); ++j) {
    if (parents[j] >= 0) depths[j] = depths[static_cast<std::size_t>(parents[j])] + 1;
    deepest = std::max(deepest, depths[j]);
  }
  return deepest;
}

}  // namespace

Json describe_asset(const io::ImportedAsset& imported) {
  const Asset& asset = imported.asset;
  const std::vector<std::string> findings = validate(asset);
  std::map<std::size_t, std::size_t> histogram;
  for (std::size_t v = 0; v < asset.skin.rows(); ++v) ++histogram[asset.skin.row_size(v)];
  std::vector<bool> weighted(asset.skeleton.size(), false);
  for (const Influence& influence : asset.skin.influences) weighted[static_cast<std::size_t>(influence.joint)] = true;

  Json json = {{"name", asset.name},
               {"joints", asset.skeleton.size()},
               {"vertices", asset.mesh.vertices.size()},
               {"faces", asset.mesh.faces.size()},
               {"skeleton_depth", depth(asset.skeleton.parents)},
               {"joints_without_weights", std::count(weighted.begin(), weighted.end(), false)}};
  json["influences"] = Json::object();
  for (const auto& [influences, vertices] : histogram) json["influences"][std::to_string(influences)] = vertices;
  const Box box = bounding_box(asset.mesh.vertices);
  json["box"] = {{"low", corner(box.low)}, {"high", corner(box.high)}};
  json["has"] = Json::array();
  if (!asset.mesh.normals.empty()) json["has"].push_back("normals");
  if (!asset.mesh.uvs.empty()) json["has"].push_back("uvs");
  if (!asset.mesh.colors.empty()) json["has"].push_back("colors");
  json["materials"] = Json::array();
  for (const Material& material : asset.materials) {
    json["materials"].push_back(material.name + (material.image >= 0 ? " (textured)" : ""));
  }
  json["images"] = asset.images.size();
  json["animations"] = Json::array();
  for (const Animation& animation : asset.animations) {
    json["animations"].push_back(
        {{"name", animation.name}, {"seconds", animation.duration()}, {"channels", animation.channels.size()}});
  }
  json["notes"] = Json::array();
  for (const io::ImportNote& note : imported.notes)
    json["notes"].push_back({{"code", note.code}, {"message", note.message}});
  json["findings"] = findings;
  return json;
}

}  // namespace anigen::eval
