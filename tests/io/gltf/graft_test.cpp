#include "anigen/io/gltf/graft.h"

#include <gtest/gtest.h>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/numeric.h"
#include "tests/io/gltf/gltf_import_support.h"
#include "tests/support/parsed_gltf.h"
#include "tests/support/paths.h"

// A rig put into a copy of a file: everything else stays, and the bind pose is that of the input.

namespace anigen::io {

namespace {

namespace fs = std::filesystem;
using test::cyclic_weights;
using test::GltfBuilder;
using test::ParsedGltf;

constexpr float kCorners[] = {-1, 0, 0, 1, 0, 0, -1, 2, 0, 1, 2, 0};

/// Node 0 "stage" holds 1 and 2, which show mesh 0, turned and of uneven scale, the second mirrored, and 3, which shows
/// mesh 1; node 4 shows nothing. Mesh 0 has tangents, two UV sets, a morph target and a material; mesh 1 two primitives
/// with their vertices in common, and a line.
GltfBuilder furnished() {
  GltfBuilder file;
  const std::vector<float> corners(std::begin(kCorners), std::end(kCorners));
  const int position = file.floats(corners, "VEC3");
  const int normal = file.floats({0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}, "VEC3");
  const int tangent = file.floats({1, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 1, 0, 0, -1}, "VEC4");
  const int uv = file.floats({0, 0, 1, 0, 0, 1, 1, 1}, "VEC2"), uv1 = file.floats({0, 0, 2, 0, 0, 2, 2, 2}, "VEC2");
  const int target = file.floats({0, 0, 0, 0, 0, 0, 0, 0.5F, 0, 0, 0.5F, 0}, "VEC3");
  const int faces = file.u16({0, 1, 2, 2, 1, 3}, "SCALAR");
  const int other = file.floats({0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1}, "VEC3");
  const int first = file.u16({0, 1, 2}, "SCALAR"), second = file.u16({0, 1, 3}, "SCALAR");
  const int line = file.floats({0, 0, 0, 0, 1.25F, 0}, "VEC3");
  file.view("odd");  // the buffer ends at no multiple of 4
  Json& json = file.json;
  json["scenes"] = Json::parse(R"([{"name": "shown", "nodes": [0, 4]}, {"nodes": [4]}])");
  json["nodes"] = Json::parse(R"([
    {"name": "stage", "translation": [1, 2, 3], "rotation": [0, 0.6, 0, 0.8], "children": [1, 2, 3]},
    {"mesh": 0, "scale": [2, 3, 0.5], "rotation": [0.6, 0, 0, 0.8], "extras": {"mood": "calm"}},
    {"mesh": 0, "scale": [-1, 1, 1], "translation": [0, -4, 0], "weights": [0.25]},
    {"extensions": {"ACME_tag": {"id": 7}}, "mesh": 1, "matrix": [1, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, 1, 0, 5, 0, 0, 1]},
    {"name": "nothing"}])");
  json["materials"] = Json::parse(R"([{"name": "gold", "pbrMetallicRoughness": {"metallicFactor": 0.9},
    "emissiveFactor": [0.1, 0.2, 0.3], "extensions": {"ACME_shine": {"power": 3}}, "extras": [1, "two", null]}])");
  json["extensionsUsed"] = {"ACME_shine", "ACME_tag"};
  json["meshes"] = Json::array();
  json["meshes"].push_back({{"name", "quad"}, {"weights", {0.5}}});
  json["meshes"][0]["primitives"].push_back(
      {{"material", 0},
       {"targets", Json::array({{{"POSITION", target}}})},
       {"attributes",
        {{"POSITION", position}, {"NORMAL", normal}, {"TANGENT", tangent}, {"TEXCOORD_0", uv}, {"TEXCOORD_1", uv1}}},
       {"indices", faces}});
  json["meshes"].push_back({{"extras", {{"length", "@number@"}, {"word", "@word@"}}}});
  json["meshes"][1]["primitives"].push_back({{"attributes", {{"POSITION", other}}}, {"indices", first}});
  json["meshes"][1]["primitives"].push_back(
      {{"attributes", {{"POSITION", other}}}, {"indices", second}, {"material", 0}});
  json["meshes"][1]["primitives"].push_back({{"attributes", {{"POSITION", line}}}, {"mode", 1}});
  return file;
}

/// The text of a .glb with a number and a string that no writer of JSON would write so.
std::string peculiar_glb(const GltfBuilder& file) {
  Json full = file.json;
  full["buffers"] = Json::array({{{"byteLength", file.buffer.size()}}});
  std::string text = full.dump(1);
  for (const auto& [from, to] : {std::pair{"\"@number@\"", "1.2500e+1"}, {"@word@", "\\u00e9\\/"}}) {
    const std::size_t at = text.find(from);
    if (at != std::string::npos) text.replace(at, std::string(from).size(), to);
  }
  return test::glb_of(text, file.buffer);
}

/// Three joints, turned against each other and against the world.
Skeleton turned_skeleton() {
  Skeleton skeleton;
  skeleton.names = {"hips", "spine", "head \"1\""};
  skeleton.parents = {-1, 0, 1};
  for (std::size_t j = 0; j < 3; ++j) {
    Transform local;
    local.translation = {0.5 + static_cast<double>(j), -0.25, 1.5};
    local.rotation = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, static_cast<double>(j)).normalized());
    skeleton.rest.push_back(local);
  }
  skeleton.bind = forward_kinematics(skeleton.parents, skeleton.rest);
  return skeleton;
}

Eigen::Matrix4d matrix_of_node(const Json& node) {
  if (node.contains("matrix")) {
    const auto m = node["matrix"].get<std::vector<double>>();
    return Eigen::Map<const Eigen::Matrix4d>(m.data());
  }
  Transform local;
  const auto t = node.value("translation", std::vector<double>{0, 0, 0});
  const auto q = node.value("rotation", std::vector<double>{0, 0, 0, 1});
  const auto s = node.value("scale", std::vector<double>{1, 1, 1});
  local.translation = {t[0], t[1], t[2]};
  local.rotation = Eigen::Quaterniond(q[3], q[0], q[1], q[2]);
  local.scale = {s[0], s[1], s[2]};
  return local.matrix();
}

std::vector<Eigen::Matrix4d> matrices_of_nodes(const Json& json) {
  const std::size_t count = json["nodes"].size();
  std::vector<int> parents(count, -1);
  for (std::size_t n = 0; n < count; ++n) {
    for (const Json& child : json["nodes"][n].value("children", Json::array()))
      parents[child.get<std::size_t>()] = static_cast<int>(n);
  }
  std::vector<Eigen::Matrix4d> world(count, Eigen::Matrix4d::Identity());
  for (std::size_t n = 0; n < count; ++n) {
    for (int up = static_cast<int>(n); up >= 0; up = parents[at(up)])
      world[n] = matrix_of_node(json["nodes"][at(up)]) * world[n];
  }
  return world;
}

/// Vertices at rest by glTF's formulas, per node and primitive: Σ w · joint · inverse bind · v, or node · v.
std::map<std::pair<std::size_t, std::size_t>, std::vector<Eigen::Vector3d>> placed_vertices(const ParsedGltf& file) {
  std::map<std::pair<std::size_t, std::size_t>, std::vector<Eigen::Vector3d>> placed;
  const Json& json = file.json;
  const std::vector<Eigen::Matrix4d> world = matrices_of_nodes(json);
  for (std::size_t n = 0; n < world.size(); ++n) {
    const Json& node = json["nodes"][n];
    if (!node.contains("mesh")) continue;
    const Json& primitives = json["meshes"][node["mesh"].get<std::size_t>()]["primitives"];
    for (std::size_t p = 0; p < primitives.size(); ++p) {
      const Json& attributes = primitives[p]["attributes"];
      const std::vector<double> positions = file.numbers(attributes["POSITION"]);
      std::vector<Eigen::Vector3d>& vertices = placed[{n, p}];
      for (std::size_t v = 0; v < positions.size() / 3; ++v) {
        const Eigen::Vector4d point(positions[3 * v], positions[3 * v + 1], positions[3 * v + 2], 1.0);
        Eigen::Vector4d moved = world[n] * point;
        if (node.contains("skin")) {
          const Json& skin = json["skins"][node["skin"].get<std::size_t>()];
          const std::vector<double> inverse = file.numbers(skin["inverseBindMatrices"]);
          moved.setZero();
          for (int set = 0; attributes.contains("JOINTS_" + std::to_string(set)); ++set) {
            const auto joints = file.numbers(attributes["JOINTS_" + std::to_string(set)]);
            const auto weights = file.numbers(attributes["WEIGHTS_" + std::to_string(set)]);
            for (std::size_t k = 4 * v; k < 4 * v + 4; ++k) {
              const auto entry = static_cast<std::size_t>(joints[k]);
              const Eigen::Matrix4d bind = Eigen::Map<const Eigen::Matrix4d>(inverse.data() + 16 * entry);
              moved += weights[k] * (world[skin["joints"][entry].get<std::size_t>()] * (bind * point));
            }
          }
        }
        vertices.emplace_back(moved.head<3>());
      }
    }
  }
  return placed;
}

void expect_same_places(const ParsedGltf& before, const ParsedGltf& after) {
  const auto placed = placed_vertices(before), again = placed_vertices(after);
  for (const auto& [place, points] : placed) {
    for (std::size_t v = 0; v < points.size(); ++v) EXPECT_LT((points[v] - again.at(place)[v]).norm(), 1e-5);
  }
}

/// The written JSON without the additions that a graft may make to this original.
Json without_additions(Json json, const Json& original) {
  for (const char* array : {"accessors", "bufferViews", "nodes", "meshes", "skins"}) {
    if (!json.contains(array)) continue;
    const std::size_t before = original.contains(array) ? original[array].size() : 0;
    json[array].erase(json[array].begin() + static_cast<std::ptrdiff_t>(before), json[array].end());
    if (!original.contains(array)) json.erase(array);
  }
  const auto without = [](Json& attributes) {
    Json rest = Json::object();
    for (const auto& [name, accessor] : attributes.items()) {
      if (name.rfind("JOINTS_", 0) != 0 && name.rfind("WEIGHTS_", 0) != 0) rest[name] = accessor;
    }
    attributes = rest;
  };
  for (Json& mesh : json["meshes"]) {
    for (Json& primitive : mesh["primitives"]) without(primitive["attributes"]);
  }
  for (std::size_t n = 0; n < json["nodes"].size(); ++n) {
    for (const char* key : {"skin", "mesh"}) {
      Json& node = json["nodes"][n];
      if (!node.contains(key)) continue;
      if (original["nodes"][n].contains(key))
        node[key] = original["nodes"][n][key];
      else
        node.erase(key);
    }
  }
  for (std::size_t s = 0; s < json["scenes"].size(); ++s) {
    Json& nodes = json["scenes"][s]["nodes"];
    nodes.erase(nodes.begin() + static_cast<std::ptrdiff_t>(original["scenes"][s]["nodes"].size()), nodes.end());
  }
  json["buffers"][0]["byteLength"] = original["buffers"][0]["byteLength"];
  return json;
}

/// The original in the same form.
Json without_weights_of(Json json) {
  const Json same = json;
  return without_additions(std::move(json), same);
}

/// The flag, and a second one on a joint without a parent.
GltfBuilder two_trees() {
  GltfBuilder file = test::flag();
  file.json["nodes"].push_back({{"mesh", 1}, {"skin", 1}});
  file.json["nodes"].push_back({{"name", "other"}, {"translation", {0.5, 1.0, 0.0}}});
  for (const int node : {3, 4}) file.json["scenes"][0]["nodes"].push_back(node);
  file.json["meshes"].push_back(file.json["meshes"][0]);
  file.json["skins"].push_back({{"joints", {4}}, {"inverseBindMatrices", 4}});
  file.json["meshes"][1]["primitives"][0]["attributes"]["JOINTS_0"] = file.u8(std::vector<std::uint8_t>(16, 0), "VEC4");
  return file;
}

class Graft : public testing::Test {
 protected:
  /// Vertices of the merged mesh.
  std::size_t save(const GltfBuilder& file, const std::string& name = "in.glb") {
    if (name == "in.glb")
      test::write_bytes(folder_ / name, peculiar_glb(file));
    else
      file.save(folder_ / name);
    ImportOptions options;
    options.require_rig = false;
    return read_gltf(folder_ / name, options).asset.mesh.vertices.size();
  }
  GraftReport graft(const Skeleton& skeleton, const SkinWeights& skin, const GraftOptions& options = {}) {
    return graft_rig(folder_ / "in.glb", skeleton, skin, folder_ / "out.glb", options);
  }
  std::string refusal(const Skeleton& skeleton, const SkinWeights& skin) {
    try {
      graft(skeleton, skin);
    } catch (const InputError& error) {
      EXPECT_FALSE(fs::exists(folder_ / "out.glb"));
      EXPECT_EQ(error.file(), (folder_ / "in.glb").string());
      return error.place() + ": " + error.problem();
    }
    return "";
  }

  test::TemporaryFolder folder_;
};

TEST_F(Graft, LeavesEverythingElseAsItIs) {
  const std::size_t vertices = save(furnished());
  const GraftReport report = graft(turned_skeleton(), cyclic_weights(vertices, 3));
  EXPECT_FALSE(report.own_joints);
  EXPECT_EQ(report.bound_nodes, 3u);
  EXPECT_EQ(report.copied_meshes, 1u);
  const ParsedGltf before(folder_ / "in.glb"), after(folder_ / "out.glb");
  EXPECT_EQ(without_additions(after.json, before.json), before.json);
  EXPECT_EQ(after.binary.substr(0, before.binary.size()), before.binary);
  const std::string bytes = read_file(folder_ / "out.glb");
  EXPECT_NE(bytes.find("\"length\": 1.2500e+1,"), std::string::npos) << "digits stay";
  EXPECT_NE(bytes.find("\\u00e9\\/"), std::string::npos) << "escapes stay";
  EXPECT_EQ(after.json["scenes"][0]["nodes"], Json({0, 4, 5})) << "the root is shown beside the meshes";
  EXPECT_EQ(after.json["scenes"][1], before.json["scenes"][1]);
  Json copy = after.json["meshes"][2];
  copy["primitives"][0]["attributes"] = before.json["meshes"][0]["primitives"][0]["attributes"];
  EXPECT_EQ(copy, before.json["meshes"][0]) << "the second instance of mesh 0 has a mesh of its own";
  EXPECT_EQ(after.json["nodes"][2]["mesh"], 2);
}

TEST_F(Graft, HasTheBindPoseOfTheInput) {
  const std::size_t vertices = save(furnished());
  graft(turned_skeleton(), cyclic_weights(vertices, 3));
  const auto before = placed_vertices(ParsedGltf(folder_ / "in.glb"));
  const auto after = placed_vertices(ParsedGltf(folder_ / "out.glb"));
  ASSERT_EQ(before.size(), after.size());
  for (const auto& [place, points] : before) {
    const std::vector<Eigen::Vector3d>& others = after.at(place);
    ASSERT_EQ(points.size(), others.size());
    for (std::size_t v = 0; v < points.size(); ++v)
      EXPECT_LT((points[v] - others[v]).norm(), 1e-5) << place.first << " " << place.second << " " << v;
  }
}

TEST_F(Graft, IsReadAsTheRigThatWasGiven) {
  const std::size_t vertices = save(furnished());
  const Skeleton skeleton = turned_skeleton();
  const SkinWeights skin = cyclic_weights(vertices, 3);
  graft(skeleton, skin);
  const Asset back = read_gltf(folder_ / "out.glb").asset;
  EXPECT_EQ(back.skeleton.names, skeleton.names);
  EXPECT_EQ(back.skeleton.parents, skeleton.parents);
  for (std::size_t j = 0; j < skeleton.size(); ++j)
    EXPECT_LT((back.skeleton.bind[j] - skeleton.bind[j]).norm(), 1e-4) << j;
  ASSERT_EQ(back.skin.rows(), skin.rows());
  // The second instance of mesh 0 is a mesh of its own now, behind mesh 1.
  const auto place = [](std::size_t v) { return v < 4 ? v : v < 8 ? v + 4 : v - 4; };
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    ASSERT_EQ(back.skin.row_size(place(v)), skin.row_size(v)) << v;
    for (std::size_t k = 0; k < skin.row_size(v); ++k) {
      EXPECT_EQ(back.skin.row(place(v))[k].joint, skin.row(v)[k].joint) << v;
      EXPECT_NEAR(back.skin.row(place(v))[k].weight, skin.row(v)[k].weight, 1e-6F) << v;
    }
  }
}

TEST_F(Graft, KeepsAsManyInfluencesAsAsked) {
  Skeleton skeleton = skeleton_from_joints(std::vector<Eigen::Vector3d>(6, {0, 0, 1}), {-1, 0, 1, 2, 3, 4});
  const std::size_t vertices = save(furnished());
  const SkinWeights skin = cyclic_weights(vertices, 6, 6);
  for (const std::size_t influences : {std::size_t{2}, std::size_t{4}, std::size_t{6}}) {
    GraftOptions options;
    options.influences = influences;
    graft(skeleton, skin, options);
    const ParsedGltf file(folder_ / "out.glb");
    EXPECT_EQ(file.json["meshes"][0]["primitives"][0]["attributes"].contains("JOINTS_1"), influences > 4);
    std::vector<double> weights = file.attribute("WEIGHTS_0");
    if (influences > 4) {
      const std::vector<double> more = file.attribute("WEIGHTS_1");
      weights.insert(weights.end(), more.begin(), more.end());
    }
    EXPECT_EQ(static_cast<std::size_t>(std::count_if(weights.begin(), weights.end(), [](double w) { return w > 0; })),
              4 * influences);
    double sum = 0.0;
    for (const double w : weights) sum += w;
    EXPECT_NEAR(sum, 4.0, 1e-6) << "divided by what is left";
  }
}

TEST_F(Graft, ManyJointsHaveWiderIndices) {
  const std::size_t vertices = save(furnished());
  for (const std::size_t joints : {std::size_t{255}, std::size_t{300}}) {
    std::vector<int> parents(joints, 0);
    parents[0] = -1;
    graft(skeleton_from_joints(std::vector<Eigen::Vector3d>(joints, {0, 0, 0}), parents),
          cyclic_weights(vertices, joints));
    const ParsedGltf file(folder_ / "out.glb");
    const Json& attributes = file.json["meshes"][0]["primitives"][0]["attributes"];
    EXPECT_EQ(file.json["accessors"][attributes["JOINTS_0"].get<std::size_t>()]["componentType"],
              joints == 255 ? 5121 : 5123);
  }
}

TEST_F(Graft, RefusesARigThatDoesNotFit) {
  const std::size_t vertices = save(furnished());
  const Skeleton skeleton = turned_skeleton();
  EXPECT_NE(refusal(skeleton, cyclic_weights(vertices + 1, 3)).find("13 rows of weights for its 12 vertices"),
            std::string::npos);
  EXPECT_NE(refusal(skeleton, cyclic_weights(vertices, 4)).find("name joint 3, which there is not"), std::string::npos);
  SkinWeights empty = cyclic_weights(vertices - 1, 3);
  empty.offsets.push_back(empty.offsets.back());
  EXPECT_NE(refusal(skeleton, empty).find("vertex 11 are missing"), std::string::npos);
  Skeleton unsound = skeleton;
  unsound.parents[1] = 2;
  EXPECT_NE(refusal(unsound, cyclic_weights(vertices, 3)).find("not sound"), std::string::npos);
  EXPECT_THROW(graft_rig(folder_ / "in.glb", skeleton, cyclic_weights(vertices, 3), folder_ / "out.obj"), InputError);
}

TEST_F(Graft, TheFilesOwnJointsKeepTheirAnimations) {
  GltfBuilder file = test::flag();
  file.animate(2, "rotation", {0, 1}, {0, 0, 0, 1, 0.6F, 0, 0, 0.8F});
  file.json["skins"][0]["name"] = "bones";
  save(file);
  const Asset own = read_gltf(folder_ / "in.glb").asset;
  // Other weights on the same joints.
  const GraftReport report = graft(own.skeleton, cyclic_weights(own.mesh.vertices.size(), 2));
  EXPECT_TRUE(report.own_joints);
  const ParsedGltf before(folder_ / "in.glb"), after(folder_ / "out.glb");
  EXPECT_EQ(after.json["animations"], before.json["animations"]);
  EXPECT_EQ(after.json["nodes"], before.json["nodes"]);
  EXPECT_EQ(after.json["skins"], before.json["skins"]);
  EXPECT_EQ(without_additions(after.json, before.json), without_weights_of(before.json));
  const Asset back = read_gltf(folder_ / "out.glb").asset;
  EXPECT_EQ(back.animations.size(), 1u);
  EXPECT_EQ(back.skeleton.names, own.skeleton.names);
  EXPECT_EQ(back.skin.largest_row(), 2u);
}

// As a skeleton of joints in places has no axes, and may list joints in another order.
TEST_F(Graft, OwnJointsAreKnownByNameAndPlace) {
  save(test::flag());
  const Asset own = read_gltf(folder_ / "in.glb").asset;
  const SkinWeights skin = cyclic_weights(4, 2);
  Skeleton plain = skeleton_from_joints(own.skeleton.positions(), own.skeleton.parents, own.skeleton.names);
  EXPECT_TRUE(graft(plain, skin).own_joints);
  plain.names[1] = "shin";
  EXPECT_FALSE(graft(plain, skin).own_joints);
  const ParsedGltf file(folder_ / "out.glb");
  EXPECT_EQ(file.json["skins"].size(), 1u) << "nothing shows the old one any more";
  EXPECT_EQ(read_gltf(folder_ / "out.glb").asset.skeleton.names, plain.names);
}

TEST_F(Graft, FurtherJointsGoBelowTheFilesOwnWhichKeepTheirAnimations) {
  GltfBuilder file = test::flag();
  file.animate(2, "rotation", {0, 1}, {0, 0, 0, 1, 0.6F, 0, 0, 0.8F});
  save(file);
  const Asset own = read_gltf(folder_ / "in.glb").asset;
  std::vector<Eigen::Vector3d> places = own.skeleton.positions();
  std::vector<int> parents = own.skeleton.parents;
  std::vector<std::string> names = own.skeleton.names;
  const auto tip = static_cast<int>(places.size());
  const Eigen::Vector3d first = places.back() + Eigen::Vector3d(0.25, 0.5, 0),
                        second = first + Eigen::Vector3d(0, 0, 1);
  places.insert(places.end(), {first, second});
  parents.insert(parents.end(), {tip - 1, tip});
  names.insert(names.end(), {"tail", "tail_end"});
  const SkinWeights skin = cyclic_weights(own.mesh.vertices.size(), places.size());
  EXPECT_TRUE(graft(skeleton_from_joints(places, parents, names), skin).own_joints);
  const ParsedGltf before(folder_ / "in.glb"), after(folder_ / "out.glb");
  EXPECT_EQ(after.json["animations"], before.json["animations"]);
  EXPECT_EQ(after.json["nodes"].size(), before.json["nodes"].size() + 2);
  const Asset back = read_gltf(folder_ / "out.glb").asset;
  ASSERT_EQ(back.skeleton.size(), places.size());
  for (std::size_t j = 0; j < places.size(); ++j) {
    const auto found = std::find(back.skeleton.names.begin(), back.skeleton.names.end(), names[j]);
    ASSERT_NE(found, back.skeleton.names.end()) << names[j];
    EXPECT_LT((back.skeleton.positions()[at(found - back.skeleton.names.begin())] - places[j]).norm(), 1e-6);
  }
  EXPECT_EQ(back.animations.size(), 1u);
  expect_same_places(before, after);
}

TEST_F(Graft, FurtherJointsOfARootThatTheFileDoesNotHave) {
  save(two_trees());
  const Asset own = read_gltf(folder_ / "in.glb").asset;
  std::vector<Eigen::Vector3d> places = own.skeleton.positions();
  std::vector<int> parents = own.skeleton.parents;
  std::vector<std::string> names = own.skeleton.names;
  places.emplace_back(2.0, 1.0, 0.5);
  parents.push_back(0);
  names.emplace_back("further");
  EXPECT_TRUE(
      graft(skeleton_from_joints(places, parents, names), cyclic_weights(own.mesh.vertices.size(), places.size()))
          .own_joints);
  const Asset back = read_gltf(folder_ / "out.glb").asset;
  const auto found = std::find(back.skeleton.names.begin(), back.skeleton.names.end(), "further");
  ASSERT_NE(found, back.skeleton.names.end());
  EXPECT_LT((back.skeleton.positions()[at(found - back.skeleton.names.begin())] - places.back()).norm(), 1e-6);
}

TEST_F(Graft, ASkinGetsTheJointsItLacks) {
  GltfBuilder file = test::flag();
  file.json["nodes"].push_back({{"mesh", 1}, {"skin", 1}});
  file.json["scenes"][0]["nodes"].push_back(3);
  file.json["meshes"].push_back(file.json["meshes"][0]);
  file.json["skins"].push_back({{"joints", {1}}, {"skeleton", 1}, {"inverseBindMatrices", 4}});
  const int all_on_hip = file.u8(std::vector<std::uint8_t>(16, 0), "VEC4");
  file.json["meshes"][1]["primitives"][0]["attributes"]["JOINTS_0"] = all_on_hip;
  save(file);
  const Asset own = read_gltf(folder_ / "in.glb").asset;
  const SkinWeights skin = cyclic_weights(own.mesh.vertices.size(), 2);
  EXPECT_TRUE(graft(own.skeleton, skin).own_joints);
  const ParsedGltf before(folder_ / "in.glb"), after(folder_ / "out.glb");
  ASSERT_EQ(after.json["skins"].size(), 3u);
  EXPECT_EQ(after.json["skins"][0], before.json["skins"][0]);
  EXPECT_EQ(after.json["skins"][1], before.json["skins"][1]);
  EXPECT_EQ(after.json["skins"][2]["joints"], Json({1, 2}));
  EXPECT_EQ(after.json["nodes"][3]["skin"], 2);
  expect_same_places(before, after);
}

TEST_F(Graft, JointsOfALongerSkinHaveACommonRoot) {
  save(two_trees());
  const Asset own = read_gltf(folder_ / "in.glb").asset;
  ASSERT_GE(own.skeleton.size(), 4u) << "a root above two trees";
  graft(own.skeleton, cyclic_weights(own.mesh.vertices.size(), own.skeleton.size()));
  const ParsedGltf before(folder_ / "in.glb"), after(folder_ / "out.glb");
  const Json& nodes = after.json["nodes"];
  std::vector<int> parents(nodes.size(), -1);
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    for (const Json& child : nodes[n].value("children", Json::array()))
      parents[child.get<std::size_t>()] = static_cast<int>(n);
  }
  for (const Json& skin : after.json["skins"]) {
    std::set<int> roots;
    for (const Json& joint : skin["joints"]) {
      int node = joint.get<int>();
      while (parents[static_cast<std::size_t>(node)] >= 0) node = parents[static_cast<std::size_t>(node)];
      roots.insert(node);
    }
    EXPECT_EQ(roots.size(), 1u) << skin;
  }
  for (const Json& root : after.json["scenes"][0]["nodes"]) EXPECT_EQ(parents[root.get<std::size_t>()], -1);
  expect_same_places(before, after);
}

TEST_F(Graft, AMeshOnAJointStaysOnIt) {
  GltfBuilder file = test::flag();
  file.json["nodes"][2]["children"] = {3};
  file.json["nodes"].push_back({{"mesh", 1}, {"translation", {0, 0, 1}}});
  file.json["meshes"].push_back(file.json["meshes"][0]);
  Json& attributes = file.json["meshes"][1]["primitives"][0]["attributes"];
  attributes.erase("JOINTS_0");
  attributes.erase("WEIGHTS_0");
  save(file);
  const Asset own = read_gltf(folder_ / "in.glb").asset;
  EXPECT_EQ(graft(own.skeleton, own.skin).bound_nodes, 1u);
  EXPECT_FALSE(ParsedGltf(folder_ / "out.glb").json["nodes"][3].contains("skin"));
  EXPECT_EQ(graft(own.skeleton, cyclic_weights(own.mesh.vertices.size(), 2)).bound_nodes, 2u);
  const ParsedGltf before(folder_ / "in.glb"), after(folder_ / "out.glb");
  EXPECT_TRUE(after.json["nodes"][3].contains("skin"));
  // Blender takes the rest pose of a joint from the last skin that has it, which has to be the file's own.
  ASSERT_EQ(after.json["skins"].size(), 2u);
  EXPECT_EQ(after.json["skins"][1], before.json["skins"][0]);
  for (std::size_t n = 0; n < before.json["nodes"].size(); ++n) {
    if (!before.json["nodes"][n].contains("skin")) continue;
    EXPECT_EQ(after.json["nodes"][n]["skin"], 1);
  }
  expect_same_places(before, after);
}

TEST_F(Graft, AnAnimationThatCarriesAllMeshesCarriesTheSkeleton) {
  GltfBuilder file = furnished();
  file.animate(0, "translation", {0, 1}, {1, 2, 3, 9, 2, 3});
  const std::size_t vertices = save(file);
  const SkinWeights skin = cyclic_weights(vertices, 3);
  graft(turned_skeleton(), skin);
  const ParsedGltf before(folder_ / "in.glb"), after(folder_ / "out.glb");
  EXPECT_EQ(after.json["nodes"][0]["children"], Json({1, 2, 3, 5}));
  EXPECT_EQ(after.json["animations"], before.json["animations"]);
  expect_same_places(before, after);
  fs::remove(folder_ / "out.glb");
  file.animate(3, "translation", {0, 1}, {0, 0, 0, 1, 0, 0});
  save(file);
  const std::string why = refusal(turned_skeleton(), skin);
  EXPECT_NE(why.find("/nodes/"), std::string::npos) << why;
  EXPECT_NE(why.find("animation 'move' moves apart"), std::string::npos) << why;
}

TEST_F(Graft, ACollapsedMeshStaysAsItIs) {
  GltfBuilder file = furnished();
  file.json["nodes"][3] = {{"mesh", 1}, {"scale", {0, 0, 0}}};
  const std::size_t vertices = save(file);
  const GraftReport report = graft(turned_skeleton(), cyclic_weights(vertices, 3));
  EXPECT_EQ(report.bound_nodes, 2u);
  ASSERT_EQ(report.notes.size(), 1u);
  EXPECT_EQ(report.notes[0].code, "collapsed_node");
  EXPECT_FALSE(ParsedGltf(folder_ / "out.glb").json["nodes"][3].contains("skin"));
}

TEST_F(Graft, AGltfAndItsFilesBecomeOneFile) {
  GltfBuilder file = furnished();
  const std::string picture = "\x89PNG\r\n\x1a\n and more";
  file.json["buffers"] = Json::array();
  file.json["buffers"].push_back({{"uri", "all.bin"}, {"byteLength", file.buffer.size()}, {"name", "all"}});
  file.json["buffers"].push_back({{"byteLength", 3}, {"uri", "more.bin"}});
  file.json["bufferViews"].push_back({{"buffer", 1}, {"byteLength", 3}});
  file.json["images"] = Json::parse(R"([{"name": "n", "uri": "a%20b.png"}, {"uri": "lost.png"}])");
  file.json["textures"] = Json::parse(R"([{"source": 0}, {"source": 1}])");
  test::write_bytes(folder_ / "all.bin", file.buffer);
  test::write_bytes(folder_ / "more.bin", "abc");
  test::write_bytes(folder_ / "a b.png", picture);
  const std::size_t vertices = save(file, "in.gltf");
  const SkinWeights skin = cyclic_weights(vertices, 3);
  const GraftReport report = graft_rig(folder_ / "in.gltf", turned_skeleton(), skin, folder_ / "deep/out.glb");
  ASSERT_EQ(report.notes.size(), 1u);
  EXPECT_EQ(report.notes[0].code, "missing_image");
  const ParsedGltf out(folder_ / "deep/out.glb");
  EXPECT_EQ(out.binary.substr(0, file.buffer.size()), file.buffer);
  EXPECT_EQ(out.json["buffers"][0], Json({{"byteLength", out.binary.size()}, {"name", "all"}}));
  EXPECT_EQ(out.json["buffers"][1]["uri"], "data:application/octet-stream;base64,YWJj");
  EXPECT_EQ(out.json["images"][0]["mimeType"], "image/png");
  EXPECT_EQ(out.json["images"][0]["name"], "n");
  EXPECT_EQ(out.image(0), picture);
  EXPECT_EQ(out.json["images"][1], Json({{"uri", "lost.png"}}));
  EXPECT_EQ(read_gltf(folder_ / "deep/out.glb").asset.mesh.vertices.size(), vertices);

  graft_rig(folder_ / "in.gltf", turned_skeleton(), skin, folder_ / "deep/out.gltf");
  EXPECT_EQ(read_gltf(folder_ / "deep/out.gltf").asset.skin.rows(), vertices) << "a .gltf with everything inside";
}

TEST_F(Graft, UnknownChunksStay) {
  std::string bytes = peculiar_glb(furnished());
  const std::string chunk = std::string("\4\0\0\0ACMEabcd", 12);
  bytes += chunk;
  for (int k = 0; k < 4; ++k)
    bytes[8 + static_cast<std::size_t>(k)] = static_cast<char>(bytes.size() >> (8 * k) & 0xFF);
  test::write_bytes(folder_ / "in.glb", bytes);
  graft(turned_skeleton(), cyclic_weights(12, 3));
  const std::string out = read_file(folder_ / "out.glb");
  EXPECT_EQ(out.substr(out.size() - chunk.size()), chunk);
  EXPECT_EQ(read_gltf(folder_ / "out.glb").asset.skin.rows(), 12u);
}

}  // namespace

}  // namespace anigen::io
