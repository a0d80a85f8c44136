// The arrays of an exported .glb, with the published exporter's axes and joints without rotation.
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/rigged_asset.h"
#include "anigen/io/gltf/export.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/parity/mesh_tensors.h"
#include "tests/parity/registry.h"
#include "tests/support/parsed_gltf.h"
#include "tests/support/paths.h"

namespace anigen::test {
namespace {

/// The fixture's skeleton as this project stores it: parents first, one root. Several roots hang on an additional one,
/// as they hang on the published "VirtualRoot".
struct OrderedSkeleton {
  std::vector<int> joint_of_fixture;  ///< [J] our index of each joint
  std::vector<Eigen::Vector3d> positions;
  std::vector<int> parents;
  bool has_virtual_root = false;
};

OrderedSkeleton ordered(const std::vector<Eigen::Vector3d>& joints, const std::vector<int>& parents) {
  OrderedSkeleton skeleton;
  skeleton.joint_of_fixture.assign(joints.size(), -1);
  skeleton.has_virtual_root = std::count(parents.begin(), parents.end(), -1) > 1;
  if (skeleton.has_virtual_root) {
    skeleton.positions.emplace_back(Eigen::Vector3d::Zero());
    skeleton.parents.push_back(-1);
  }
  std::vector<std::size_t> waiting;
  const auto add_children_of = [&](int parent) {
    for (std::size_t j = 0; j < parents.size(); ++j) {
      if (parents[j] == parent) waiting.push_back(j);
    }
  };
  add_children_of(-1);
  for (std::size_t next = 0; next < waiting.size(); ++next) {
    const std::size_t joint = waiting[next];
    const int parent = parents[joint];
    const int root = skeleton.has_virtual_root ? 0 : -1;
    skeleton.joint_of_fixture[joint] = static_cast<int>(skeleton.positions.size());
    skeleton.parents.push_back(parent < 0 ? root : skeleton.joint_of_fixture[static_cast<std::size_t>(parent)]);
    skeleton.positions.push_back(joints[joint]);
    add_children_of(static_cast<int>(joint));
  }
  return skeleton;
}

class ExportedCase {
 public:
  ExportedCase(Fixture& fixture, std::string name)
      : fixture_(fixture),
        name_(std::move(name)),
        skeleton_(ordered(points(fixture.input(name_ + "joints")), ints(fixture.input(name_ + "parents")))),
        gltf_(written()) {}

  void check() {
    const auto& joint_of = skeleton_.joint_of_fixture;
    const auto vertices = fixture_.input(name_ + "vertices").size(0);
    const auto joints = static_cast<std::int64_t>(joint_of.size());
    check_floats("positions", gltf_.attribute("POSITION"), {vertices, 3});
    check_floats("normals", gltf_.attribute("NORMAL"), {vertices, 3});
    check_floats("weights0", gltf_.attribute("WEIGHTS_0"), {vertices, 4});
    fixture_.check(name_ + "joints0", joint_slots(vertices));

    const Json& nodes = gltf_.json.at("nodes");
    const std::vector<double> all_matrices =
        gltf_.numbers(gltf_.json.at("skins").at(0).at("inverseBindMatrices").get<std::size_t>());
    std::vector<double> matrices, translations;
    torch::Tensor children = torch::zeros({joints, joints}, torch::kInt32);
    for (std::int64_t j = 0; j < joints; ++j) {
      const int joint = joint_of[static_cast<std::size_t>(j)];
      const auto first = all_matrices.begin() + 16 * joint;
      matrices.insert(matrices.end(), first, first + 16);
      const Json& node = nodes.at(static_cast<std::size_t>(joint));
      for (const double x : node.at("translation").get<std::vector<double>>()) translations.push_back(x);
      fixture_.check_true(name_ + "joint " + std::to_string(j) + " has no rotation", is_unrotated(node));
      for (const int child : node.value("children", std::vector<int>())) {
        const auto k = std::find(joint_of.begin(), joint_of.end(), child) - joint_of.begin();
        if (k < joints) children.index_put_({j, k}, 1);
      }
    }
    check_floats("ibm", matrices, {joints, 16});
    check_floats("translation", translations, {joints, 3});
    fixture_.check(name_ + "children", children);
    fixture_.check(name_ + "scene_roots", scene_roots(joints));
  }

 private:
  ParsedGltf written() const {
    Asset asset;
    asset.mesh.vertices = float_points(fixture_.input(name_ + "vertices"));
    asset.mesh.faces = triangles(fixture_.input(name_ + "faces"));
    asset.mesh.normals = angle_weighted_normals(asset.mesh.vertices, asset.mesh.faces);
    io::ExportOptions options;
    options.axes = io::ExportAxes::kPublished;
    asset.skeleton = io::unrotated_in_file(skeleton_from_joints(skeleton_.positions, skeleton_.parents), options.axes);
    asset.skin = skin_rows(fixture_.input(name_ + "skin"));
    for (Influence& influence : asset.skin.influences)
      influence.joint = skeleton_.joint_of_fixture[static_cast<std::size_t>(influence.joint)];
    const TemporaryFolder folder;
    io::write_gltf(folder / "asset.glb", asset, options);
    return ParsedGltf(folder / "asset.glb");
  }

  void check_floats(const std::string& output, const std::vector<double>& values,
                    const std::vector<std::int64_t>& shape) {
    fixture_.check(name_ + output, torch::tensor(values, torch::kFloat64).reshape(shape));
  }

  static bool is_unrotated(const Json& node) {
    const auto rotation = node.at("rotation").get<std::vector<double>>();
    return std::abs(rotation[0]) + std::abs(rotation[1]) + std::abs(rotation[2]) < 1e-12;
  }

  /// Joints under the fixture's numbers. A slot without weight names no joint: it has the fixture's there.
  torch::Tensor joint_slots(std::int64_t vertices) const {
    const auto& joint_of = skeleton_.joint_of_fixture;
    const std::vector<double> ours = gltf_.attribute("JOINTS_0"), weights = gltf_.attribute("WEIGHTS_0");
    const torch::Tensor slots = fixture_.expected(name_ + "joints0").to(torch::kInt32).contiguous().clone();
    for (std::size_t i = 0; i < ours.size(); ++i) {
      if (weights[i] == 0.0) continue;
      const auto joint = std::find(joint_of.begin(), joint_of.end(), static_cast<int>(ours[i])) - joint_of.begin();
      slots.data_ptr<std::int32_t>()[i] = static_cast<std::int32_t>(joint);
    }
    return slots.reshape({vertices, 4});
  }

  /// Node numbers as the published file has them: 0 the mesh, then the joints, then the virtual root.
  torch::Tensor scene_roots(std::int64_t joints) const {
    std::vector<std::int64_t> roots;
    for (const int node : gltf_.json.at("scenes").at(0).at("nodes").get<std::vector<int>>()) {
      const auto& joint_of = skeleton_.joint_of_fixture;
      const auto joint = std::find(joint_of.begin(), joint_of.end(), node) - joint_of.begin();
      const bool is_mesh = gltf_.json.at("nodes").at(static_cast<std::size_t>(node)).contains("mesh");
      roots.push_back(is_mesh ? 0 : joint < joints ? joint + 1 : joints + 1);
    }
    std::sort(roots.begin(), roots.end());
    return torch::tensor(roots);
  }

  Fixture& fixture_;
  std::string name_;
  OrderedSkeleton skeleton_;
  ParsedGltf gltf_;
};

void run_export_skin(Fixture& fixture) {
  for (std::size_t c = 0; c < fixture.config().at("J").size(); ++c)
    ExportedCase(fixture, "c" + std::to_string(c) + ".").check();
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ops_data_export_skin, anigen::test::run_export_skin)
