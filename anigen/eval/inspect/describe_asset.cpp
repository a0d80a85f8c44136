#include <algorithm>
#include <array>
#include <cstdlib>
#include <map>
#include <numeric>

#include "anigen/asset/validate.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/eval/inspect/inspect.h"
#include "anigen/io/image_probe.h"

namespace anigen::eval {
namespace {

Json corner(const Eigen::Vector3d& p) { return {p.x(), p.y(), p.z()}; }

/// Longest chain of joints from the root, counted in joints.
std::size_t depth(const std::vector<int>& parents) {
  std::vector<std::size_t> depths(parents.size(), 1);
  std::size_t deepest = 0;
  for (std::size_t j = 0; j < parents.size(); ++j) {
    if (parents[j] >= 0) depths[j] = depths[at(parents[j])] + 1;
    deepest = std::max(deepest, depths[j]);
  }
  return deepest;
}

/// Pieces of a mesh that no face joins; vertices in one place count as one, since files split them at seams.
class Shells {
 public:
  explicit Shells(const Mesh& mesh) : up_(mesh.vertices.size()) {
    std::iota(up_.begin(), up_.end(), std::size_t{0});
    std::map<std::array<float, 3>, std::size_t> first;
    for (std::size_t v = 0; v < up_.size(); ++v) {
      const Eigen::Vector3f& p = mesh.vertices[v];
      if (!p.allFinite()) continue;  // NaN has no order
      up_[v] = first.try_emplace({p.x(), p.y(), p.z()}, v).first->second;
    }
    for (const Triangle& face : mesh.faces) {
      for (const std::int32_t v : {face[1], face[2]}) up_[top(at(v))] = top(at(face[0]));
    }
    std::vector<char> has_face(up_.size(), 0);
    for (const Triangle& face : mesh.faces) has_face[top(at(face[0]))] = 1;
    count_ = static_cast<std::size_t>(std::count(has_face.begin(), has_face.end(), 1));
  }
  std::size_t count() const { return count_; }

 private:
  std::size_t top(std::size_t v) {
    for (; up_[v] != v; v = up_[v]) up_[v] = up_[up_[v]];
    return v;
  }
  std::vector<std::size_t> up_;
  std::size_t count_ = 0;
};

/// Before importers put several under one.
std::size_t roots(const io::ImportedAsset& imported) {
  for (const io::ImportNote& note : imported.notes) {
    if (note.code == "several_roots") return std::strtoul(note.message.c_str(), nullptr, 10);
  }
  return imported.asset.skeleton.size() > 0 ? 1 : 0;
}

std::string texture(const EncodedImage& image) {
  std::string text = image.name.empty() ? image.mime_type : image.name + " " + image.mime_type;
  try {
    const io::PictureSize size = io::probe_picture(image.bytes, image.name);
    return text + " " + std::to_string(size.width) + " x " + std::to_string(size.height);
  } catch (const InputError& error) {
    return text + " (" + error.problem() + ")";
  }
}

/// Faces may be out of range in what no importer checked; then the pieces are not counted.
bool faces_are_sound(const Mesh& mesh) {
  return std::all_of(mesh.faces.begin(), mesh.faces.end(), [&mesh](const Triangle& face) {
    return std::all_of(face.begin(), face.end(),
                       [&mesh](std::int32_t v) { return v >= 0 && at(v) < mesh.vertices.size(); });
  });
}

void add_mesh(const Asset& asset, Json& json) {
  const Mesh& mesh = asset.mesh;
  if (faces_are_sound(mesh)) json["parts"] = Shells(mesh).count();
  const Box box = bounding_box(mesh.vertices);
  json["box"] = {{"low", corner(box.low)}, {"high", corner(box.high)}};
  json["has"] = Json::array();
  if (!mesh.normals.empty()) json["has"].push_back("normals");
  if (!mesh.uvs.empty()) json["has"].push_back("uvs");
  if (!mesh.colors.empty()) json["has"].push_back("colors");
}

void add_skin(const Asset& asset, Json& json) {
  std::vector<bool> weighted(asset.skeleton.size(), false);
  std::map<std::size_t, std::size_t> histogram;
  for (std::size_t v = 0; v < asset.skin.rows(); ++v) ++histogram[asset.skin.row_size(v)];
  for (const Influence& influence : asset.skin.influences) weighted[at(influence.joint)] = true;
  json["joints_without_weights"] = std::count(weighted.begin(), weighted.end(), false);
  json["influences"] = Json::object();
  for (const auto& [influences, vertices] : histogram) json["influences"][std::to_string(influences)] = vertices;
}

const char* rig(const Asset& asset) {
  const bool has_mesh = !asset.mesh.vertices.empty();
  if (asset.skin.rows() > 0) return "skinned";
  if (has_mesh && asset.skeleton.size() > 0) return "a skeleton, no skin weights";
  if (has_mesh) return asset.mesh.faces.empty() ? "none: points, no rig" : "none: a mesh, no rig";
  return asset.animations.empty() ? "a skeleton, no mesh" : "a skeleton with motion, no mesh";
}

const char* kind(const Asset& asset) {
  const bool has_mesh = !asset.mesh.vertices.empty();
  if (asset.skin.rows() > 0) return "asset";
  if (has_mesh && asset.skeleton.size() > 0) return "rig";
  if (has_mesh) return asset.mesh.faces.empty() ? "points" : "mesh";
  return asset.animations.empty() ? "skeleton" : "motion";
}

}  // namespace

Json describe_asset(const io::ImportedAsset& imported) {
  const Asset& asset = imported.asset;
  Json json = {{"name", asset.name},
               {"rig", rig(asset)},
               {"joints", asset.skeleton.size()},
               {"vertices", asset.mesh.vertices.size()},
               {"faces", asset.mesh.faces.size()}};
  if (asset.skeleton.size() > 0) {
    json["roots"] = roots(imported);
    json["skeleton_depth"] = depth(asset.skeleton.parents);
  }
  if (asset.skin.rows() > 0) add_skin(asset, json);
  if (!asset.mesh.vertices.empty()) add_mesh(asset, json);
  json["materials"] = Json::array();
  for (const Material& material : asset.materials) {
    json["materials"].push_back(material.name + (material.image >= 0 ? " (textured)" : ""));
  }
  json["images"] = asset.images.size();
  if (!asset.images.empty()) json["textures"] = Json::array();
  for (const EncodedImage& image : asset.images) json["textures"].push_back(texture(image));
  json["animations"] = Json::array();
  for (const Animation& animation : asset.animations) {
    json["animations"].push_back(
        {{"name", animation.name}, {"seconds", animation.duration()}, {"channels", animation.channels.size()}});
  }
  for (const io::NodeClip& clip : imported.node_clips) {
    json["animations_of_nodes"].push_back({{"name", clip.name}, {"seconds", clip.seconds}, {"channels", clip.tracks}});
  }
  json["notes"] = Json::array();
  for (const io::ImportNote& note : imported.notes)
    json["notes"].push_back({{"code", note.code}, {"message", note.message}});
  json["findings"] = validate(asset, 3, false);
  return json;
}

Json describe_geometry(const std::filesystem::path& path, const Geometry& geometry) {
  Json json = {{"file", path.string()}, {"kind", kind(geometry.imported.asset)}};
  json.update(geometry.source);
  json.update(describe_asset(geometry.imported));
  return json;
}

}  // namespace anigen::eval
