#include "anigen/eval/metric_table.h"

#include <gtest/gtest.h>

#include <limits>
#include <map>

#include "anigen/core/error.h"
#include "anigen/eval/pair.h"
#include "tests/eval/rigged_walker.h"
#include "tests/geometry/uv_atlas/surface_zoo.h"

namespace anigen::eval {
namespace {

/// Shapes in memory, the word before the dash of an id being its category.
class MemorySource : public io::ShapeSource {
 public:
  std::map<std::string, Mesh> meshes;

  std::vector<std::string> ids() const override {
    std::vector<std::string> result;
    for (const auto& [id, mesh] : meshes) result.push_back(id);
    return result;
  }
  io::RiggedShape read(const std::string& id) const override {
    io::RiggedShape shape;
    shape.id = id;
    shape.mesh = meshes.at(id);
    return shape;
  }
  std::string describe() const override { return "meshes of a test"; }
  std::string category(const std::string& id) const override {
    const std::size_t dash = id.find('-');
    return dash == std::string::npos ? "" : id.substr(0, dash);
  }
};

Mesh moved(Mesh mesh, float scale, const Eigen::Vector3f& by) {
  for (Eigen::Vector3f& vertex : mesh.vertices) vertex = scale * vertex + by;
  return mesh;
}

MemorySource shapes() {
  MemorySource source;
  source.meshes["ball-1"] = test::round_sphere(1.0, 12, 16);
  source.meshes["cube-1"] = test::unit_cube();
  source.meshes["ring-thick"] = test::torus(1.0, 0.4, 24, 12);
  source.meshes["ring-thin"] = test::torus(1.0, 0.1, 24, 12);
  source.meshes["unsorted"] = test::round_sphere(1.0, 12, 16);
  source.meshes["empty-1"] = Mesh();
  return source;
}

TEST(CategoryReferences, SortsSurfacesWhateverTheirSizeAndPlace) {
  const MemorySource source = shapes();
  const CategoryReferences references(source, source.ids(), 0);
  EXPECT_EQ(references.size(), 4u);  // not the one without a category, nor the one without faces
  const auto ball = references.nearest(moved(test::round_sphere(1.0, 20, 30), 7.0f, {1, -2, 3}));
  EXPECT_EQ(ball.id, "ball-1");
  EXPECT_EQ(ball.category, "ball");
  EXPECT_LT(ball.chamfer, 0.06);  // about ½ √(π / 512), two samplings of one sphere of diameter 1
  EXPECT_EQ(references.nearest(moved(test::torus(1.0, 0.15, 40, 20), 0.01f, {5, 5, 5})).id, "ring-thin");
  EXPECT_EQ(references.nearest(test::torus(1.0, 0.35, 40, 20)).id, "ring-thick");
  EXPECT_EQ(references.nearest(test::unit_cube()).category, "cube");
}

TEST(CategoryReferences, TheTruthItselfMayNotAnswer) {
  const MemorySource source = shapes();
  const CategoryReferences references(source, source.ids(), 0);
  EXPECT_EQ(references.nearest(source.meshes.at("ring-thin"), "ring-thin").id, "ring-thick");
}

TEST(CategoryReferences, NothingToGoByIsAnError) {
  const MemorySource source = shapes();
  const CategoryReferences none(source, {"unsorted", "empty-1"}, 0);
  EXPECT_EQ(none.size(), 0u);
  EXPECT_THROW(none.nearest(test::unit_cube()), InputError);
  const CategoryReferences one(source, {"ball-1"}, 0);
  EXPECT_THROW(one.nearest(test::unit_cube(), "ball-1"), InputError);
  EXPECT_THROW(one.nearest(Mesh()), InputError);
}

TEST(CategoryReferences, AreToldApartBySeedAndIds) {
  const MemorySource source = shapes();
  const CategoryReferences all(source, source.ids(), 0);
  EXPECT_EQ(all.describe(), CategoryReferences(source, source.ids(), 0).describe());
  EXPECT_NE(all.describe(), CategoryReferences(source, source.ids(), 1).describe());
  EXPECT_NE(all.describe(), CategoryReferences(source, {"ball-1", "cube-1"}, 0).describe());
  MemorySource other = source;
  other.meshes["cube-1"] = test::round_sphere(1.0, 6, 8);
  EXPECT_NE(all.describe(), CategoryReferences(other, other.ids(), 0).describe());
  other.meshes["cube-1"].vertices[0].x() = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(CategoryReferences(other, other.ids(), 0).size(), 3u) << "what cannot be sampled is left out";
}

TEST(PairEvaluation, CategoryIsAMetricOnlyWhereItIsAskedAndKnown) {
  MemorySource source = shapes();
  const io::RiggedShape walker = test::rigged_walker();
  source.meshes["walker-other"] = test::rigged_walker(10).mesh;
  const CategoryReferences references(source, source.ids(), 0);
  PairSettings settings;
  settings.groups = {"surface"};
  settings.surface_samples = 500;
  settings.alignment.icp = false;
  EXPECT_EQ(evaluate_pair(walker, walker, settings).not_computed.count("category"), 1u);
  const auto ask = [&](const std::string& expected) {
    return evaluate_pair(walker, walker, settings, {}, {&references, expected, "walker-1"});
  };
  EXPECT_EQ(ask("walker").value("category"), 1.0);
  EXPECT_EQ(ask("ball").value("category"), 0.0);
  EXPECT_EQ(ask("ball").details.at("category").at("is"), "walker");
  EXPECT_EQ(ask("").not_computed.count("category"), 1u);
}

}  // namespace
}  // namespace anigen::eval
