// Skin weights of generated meshes: pruned by hops along the skeleton, smoothed over the mesh.
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/skeleton_field/field.h"
#include "anigen/skeleton_field/skeleton_repair.h"
#include "tests/parity/mesh_tensors.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

torch::Tensor dense(const SkinWeights& skin, std::int64_t joints) {
  return torch::tensor(to_dense(skin, static_cast<std::size_t>(joints))).reshape({-1, joints});
}

std::vector<int> nearest_anchors(const Fixture& fixture, const std::string& mesh) {
  std::vector<int> anchors;
  for (const skeleton_field::NearestJoints& nearest : skeleton_field::nearest_joints(
           points(fixture.input(mesh + "vertices")), points(fixture.input(mesh + "joints")))) {
    anchors.push_back(nearest.joint);
  }
  return anchors;
}

void check_mesh_skin(Fixture& fixture, const std::string& mesh) {
  const Json& config = fixture.config();
  const torch::Tensor input = fixture.input(mesh + "skin");
  const std::int64_t joints = input.size(1);
  const SkinWeights skin = skin_rows(input);
  const std::vector<int> parents = skeleton_field::repair_parents_as_published(
      float_points(fixture.input(mesh + "joints")), ints(fixture.input(mesh + "parents")));
  const auto hops = skeleton_field::hop_distances(parents);
  const int max_hops = published_max_hops(static_cast<std::size_t>(joints));
  fixture.check(mesh + "max_hops", torch::full({}, max_hops, torch::kInt64));
  fixture.check(mesh + "filtered", dense(filter_skin(skin, hops, max_hops), joints));
  fixture.check(mesh + "filtered_euclid",
                dense(filter_skin(skin, hops, max_hops, nearest_anchors(fixture, mesh)), joints));

  const MeshEdges edges(triangles(fixture.input(mesh + "faces")), skin.rows());
  std::vector<std::int64_t> pairs;
  for (const MeshEdges::Edge& edge : edges.all()) pairs.insert(pairs.end(), edge.begin(), edge.end());
  fixture.check(mesh + "edges", torch::tensor(pairs).reshape({-1, 2}));
  SkinSmoothing smoothing;
  smoothing.iterations = config.at("iterations");
  smoothing.alpha = config.at("alpha");
  smoothing.empties_isolated = true;
  fixture.check(mesh + "smoothed",
                dense(smooth_skin(skin, edges, static_cast<std::size_t>(joints), smoothing), joints));
}

void run_skin_utils(Fixture& fixture) {
  for (std::size_t m = 0; m < fixture.config().at("J").size(); ++m)
    check_mesh_skin(fixture, "m" + std::to_string(m) + ".");
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ops_data_skin_utils, anigen::test::run_skin_utils)
