#include "anigen/eval/describe.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <set>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/eval/inspect.h"
#include "anigen/geometry/primitives.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/render/picture.h"

namespace anigen::eval {

namespace {

using render::PictureMode;
using render::PictureOptions;
using render::Tile;

std::string joints(const Asset& asset) { return std::to_string(asset.skeleton.size()) + " joints"; }

std::vector<Tile> skinned(const Asset& asset, PictureOptions options) {
  std::vector<Tile> tiles = {{render::render(asset, options), "colour"}};
  options.mode = PictureMode::kWeights;
  tiles.push_back({render::render(asset, options), "skin weights"});
  options.skeleton = true;
  tiles.push_back({render::render(asset, options), joints(asset)});
  return tiles;
}

std::vector<Tile> unskinned(const Asset& asset, PictureOptions options) {
  if (asset.mesh.faces.empty()) throw InputError("", "", "points without faces cannot be drawn");
  std::vector<Tile> tiles = {{render::render(asset, options), "colour"}};
  if (asset.skeleton.size() > 0) {
    options.skeleton = true;
    tiles.push_back({render::render(asset, options), joints(asset) + ", no skin weights"});
  } else {
    options.mode = PictureMode::kNormals;
    tiles.push_back({render::render(asset, options), "normals; no rig"});
  }
  return tiles;
}

Asset solid(const Skeleton& skeleton, const Pose& pose) {
  std::vector<Eigen::Vector3d> places;
  for (const Eigen::Matrix4d& world : forward_kinematics(skeleton.parents, pose))
    places.emplace_back(world.topRightCorner<3, 1>());
  return geometry::skeleton_asset(skeleton_from_joints(places, skeleton.parents, skeleton.names));
}

std::vector<Tile> skeleton(const Asset& asset, const PictureOptions& options) {
  std::vector<Tile> tiles = {{render::render(solid(asset.skeleton, asset.skeleton.rest), options), joints(asset)}};
  if (asset.animations.empty()) return tiles;
  const Animation& animation = asset.animations.front();
  const double time = animation.duration() / 2.0;
  char seconds[32];
  std::snprintf(seconds, sizeof seconds, " at %.2f s", time);
  tiles.push_back({render::render(solid(asset.skeleton, sample(animation, asset.skeleton, time)), options),
                   animation.name + seconds});
  return tiles;
}

double row_l1(const SkinWeights& a, const SkinWeights& b, std::size_t v) {
  std::map<std::int32_t, double> difference;
  for (std::size_t i = 0; i < a.row_size(v); ++i) difference[a.row(v)[i].joint] += a.row(v)[i].weight;
  for (std::size_t i = 0; i < b.row_size(v); ++i) difference[b.row(v)[i].joint] -= b.row(v)[i].weight;
  double sum = 0;
  for (const auto& entry : difference) sum += std::abs(entry.second);
  return sum;
}

/// The asset with only some of its vertices and no faces: all that skinning needs.
Asset only_vertices(const Asset& asset, const std::vector<std::size_t>& kept) {
  Asset part;
  part.skeleton = asset.skeleton;
  for (const std::size_t v : kept) {
    part.mesh.vertices.push_back(asset.mesh.vertices[v]);
    part.skin.append_row({asset.skin.row(v), asset.skin.row(v) + asset.skin.row_size(v)});
  }
  return part;
}

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
std::size_t shells(const Mesh& mesh) {
  DisjointSets sets(mesh.vertices.size());
  std::map<std::array<float, 3>, std::size_t> first;
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const Eigen::Vector3f& p = mesh.vertices[v];
    if (p.allFinite()) sets.join(first.try_emplace({p.x(), p.y(), p.z()}, v).first->second, v);  // NaN has no order
  }
  for (const Triangle& face : mesh.faces) {
    for (const std::int32_t v : {face[1], face[2]}) sets.join(at(face[0]), at(v));
  }
  std::set<std::size_t> with_faces;
  for (const Triangle& face : mesh.faces) with_faces.insert(sets.find(at(face[0])));
  return with_faces.size();
}

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
  if (faces_are_sound(mesh)) json["parts"] = shells(mesh);
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

/// The kind of file in a word, and what rig it has.
std::pair<const char*, const char*> kind_and_rig(const Asset& asset) {
  const bool has_mesh = !asset.mesh.vertices.empty();
  if (asset.skin.rows() > 0) return {"asset", "skinned"};
  if (has_mesh && asset.skeleton.size() > 0) return {"rig", "a skeleton, no skin weights"};
  if (has_mesh && asset.mesh.faces.empty()) return {"points", "none: points, no rig"};
  if (has_mesh) return {"mesh", "none: a mesh, no rig"};
  if (asset.animations.empty()) return {"skeleton", "a skeleton, no mesh"};
  return {"motion", "a skeleton with motion, no mesh"};
}

bool plain(const Json& value) { return !value.is_object() && !value.is_array(); }

/// Names come from foreign files and need not be UTF-8, which JSON demands.
std::string compact(const Json& value) { return value.dump(-1, ' ', false, Json::error_handler_t::replace); }

std::string word(const Json& value) { return value.is_string() ? value.get<std::string>() : compact(value); }

/// "a, b, c" for lists of plain values, "k: v, k: v" for objects of plain values; empty when it does not fit a line.
std::string one_line(const Json& value) {
  if (plain(value)) return word(value);
  std::string text;
  for (const auto& [key, item] : value.items()) {
    const bool flat_list = item.is_array() && std::all_of(item.begin(), item.end(), plain);
    if (!plain(item) && !flat_list) return "";
    text += (text.empty() ? "" : ", ") + (value.is_object() ? key + " " : std::string()) +
            (flat_list ? compact(item) : word(item));
  }
  if (text.empty()) return "none";
  return text.size() <= 160 ? text : "";
}

void append(std::string& text, const Json& value, std::size_t indent) {
  const std::string margin(indent, ' ');
  for (const auto& [key, item] : value.items()) {
    const std::string head = margin + (value.is_object() ? key + ": " : std::string("- "));
    const std::string line = one_line(item);
    if (!line.empty() || plain(item)) {
      text += head + line + "\n";
    } else {
      text += head + "\n";
      append(text, item, indent + 2);
    }
  }
}

std::string cell(const Json& description, const char* key) {
  return description.contains(key) ? description[key].dump() : std::string();
}

/// "12 arrays, 345 numbers" of what a description counts under these keys.
std::string counts(const Json& description, const std::vector<std::pair<const char*, const char*>>& words) {
  std::string text;
  for (const auto& [key, word] : words) {
    const std::string value = cell(description, key);
    if (!value.empty()) text += (text.empty() ? "" : ", ") + value + " " + word;
  }
  return text;
}

std::string summary(const Json& description) {
  if (description.contains("width"))
    return description.value("format", "") + ", " + cell(description, "width") + " x " + cell(description, "height") +
           ", " + cell(description, "channels") + " channels of " + cell(description, "bits") + " bits";
  return counts(description, {{"samples", "samples"},
                              {"arrays", "arrays"},
                              {"numbers", "numbers"},
                              {"rows", "rows"},
                              {"checkpoint_steps", "checkpoint steps"},
                              {"files", "files"}});
}

std::string repairs(const Json& description) {
  std::string text;
  if (!description.contains("notes")) return summary(description);
  for (const Json& note : description["notes"]) {
    const std::string code = note["code"].get<std::string>();
    text += (text.empty() ? "" : " ") + (code == "note" ? note["message"].get<std::string>() : code);
  }
  return text;
}

std::string most_influences(const Json& description) {
  std::size_t most = 0;
  if (!description.contains("influences")) return "";
  for (const auto& [count, vertices] : description["influences"].items())
    most = std::max<std::size_t>(most, std::stoul(count));
  return std::to_string(most);
}

}  // namespace

io::Image asset_picture(const Asset& asset, int size) {
  PictureOptions options;
  options.width = options.height = size;
  const std::vector<Tile> tiles = asset.skin.rows() > 0          ? skinned(asset, options)
                                  : !asset.mesh.vertices.empty() ? unskinned(asset, options)
                                                                 : skeleton(asset, options);
  render::SheetOptions sheet;
  sheet.columns = static_cast<int>(tiles.size());
  sheet.title = asset.name;
  return render::contact_sheet(tiles, sheet);
}

InfluenceLoss influence_loss(const Asset& asset, std::size_t influences, std::size_t frames_per_animation) {
  InfluenceLoss loss;
  loss.influences = influences;
  std::vector<std::size_t> affected;
  for (std::size_t v = 0; v < asset.skin.rows(); ++v) {
    if (asset.skin.row_size(v) > influences) affected.push_back(v);
  }
  loss.affected = affected.size();
  loss.frames = asset.animations.size() * frames_per_animation;
  if (affected.empty()) return loss;

  const Asset full = only_vertices(asset, affected);
  Asset limited = full;
  limited.skin = limit_influences(full.skin, influences);
  for (std::size_t v = 0; v < affected.size(); ++v) {
    const double l1 = row_l1(full.skin, limited.skin, v);
    loss.max_l1 = std::max(loss.max_l1, l1);
    loss.mean_l1 += l1 / static_cast<double>(asset.skin.rows());
  }
  double farthest = 0;
  for (const Animation& animation : asset.animations) {
    for (std::size_t frame = 0; frame < frames_per_animation; ++frame) {
      const double part =
          frames_per_animation > 1 ? static_cast<double>(frame) / static_cast<double>(frames_per_animation - 1) : 0;
      const auto world =
          forward_kinematics(asset.skeleton.parents, sample(animation, asset.skeleton, part * animation.duration()));
      const auto a = skin_vertices(full, world), b = skin_vertices(limited, world);
      for (std::size_t v = 0; v < a.size(); ++v)
        farthest = std::max(farthest, static_cast<double>((a[v] - b[v]).norm()));
    }
  }
  const double diagonal = bounding_box(asset.mesh.vertices).diagonal();
  loss.max_displacement = diagonal > 0 ? farthest / diagonal : 0;
  return loss;
}

Json to_json(const InfluenceLoss& loss) {
  return {{"influences", loss.influences}, {"affected", loss.affected}, {"mean_l1", loss.mean_l1},
          {"max_l1", loss.max_l1},         {"frames", loss.frames},     {"max_displacement", loss.max_displacement}};
}

Json describe_asset(const io::ImportedAsset& imported) {
  const Asset& asset = imported.asset;
  Json json = {{"name", asset.name},
               {"rig", kind_and_rig(asset).second},
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
  for (const Material& material : asset.materials)
    json["materials"].push_back(material.name + (material.image >= 0 ? " (textured)" : ""));
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
  Json json = {{"file", path.string()}, {"kind", kind_and_rig(geometry.imported.asset).first}};
  json.update(geometry.source);
  json.update(describe_asset(geometry.imported));
  return json;
}

std::string to_text(const Json& description) {
  std::string text;
  append(text, description, 0);
  return text;
}

anigen::Table file_table(const std::vector<InspectedFile>& files) {
  const bool losses = std::any_of(files.begin(), files.end(),
                                  [](const InspectedFile& f) { return f.description.contains("influence_loss"); });
  const bool kinds = std::any_of(files.begin(), files.end(), [](const InspectedFile& f) {
    return f.rejection.empty() && f.description.value("kind", "asset") != "asset";
  });
  anigen::Table table{{"file", "joints", "vertices", "faces", "influences"}, {}};
  if (kinds) table.columns.insert(table.columns.begin() + 1, "kind");
  if (losses) {
    for (const char* name : {"affected", "max l1", "mean l1", "frames", "max shift / diagonal"})
      table.columns.push_back(name);
  }
  table.columns.push_back("repairs or rejection");
  for (const InspectedFile& file : files) {
    const Json& d = file.description;
    std::vector<std::string> row = {file.file, cell(d, "joints"), cell(d, "vertices"), cell(d, "faces"),
                                    most_influences(d)};
    if (kinds) row.insert(row.begin() + 1, file.rejection.empty() ? d.value("kind", "") : "");
    if (losses && d.contains("influence_loss")) {
      const Json& loss = d["influence_loss"];
      row.push_back(loss["affected"].dump());
      row.push_back(anigen::fixed(loss["max_l1"].get<double>()));
      row.push_back(anigen::fixed(loss["mean_l1"].get<double>()));
      row.push_back(loss["frames"].dump());
      row.push_back(loss["frames"] == 0 ? "–" : anigen::fixed(loss["max_displacement"].get<double>()));
    } else if (losses) {
      row.resize(row.size() + 5);
    }
    row.push_back(file.rejection.empty() ? repairs(d) : "rejected: " + file.rejection);
    table.rows.push_back(std::move(row));
  }
  return table;
}

Json to_json(const std::vector<InspectedFile>& files) {
  Json list = Json::array();
  for (const InspectedFile& file : files) {
    list.push_back(file.rejection.empty() ? file.description : Json{{"file", file.file}, {"rejected", file.rejection}});
  }
  return files.size() == 1 ? list[0] : list;
}

}  // namespace anigen::eval
