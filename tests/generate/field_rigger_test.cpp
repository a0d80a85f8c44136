// Skeletons of given meshes by the small flows of the parity fixtures, made into flows without pictures, the first one
// of given shapes.
#include "anigen/generate/field_rigger.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/generate/grouping.h"
#include "anigen/geometry/primitives.h"
#include "tests/generate/small_runs.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::generate {
namespace {

namespace fs = std::filesystem;

class FieldRiggerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const fs::path tree = test::parity_file("ckpt_tree");
    if (!fs::is_directory(tree)) {
      GTEST_SKIP() << tree << " is not there";
    }
    fs::copy(tree, folder_.path(), fs::copy_options::recursive);
    const fs::path runs = folder_ / "ckpts" / "anigen";
    request_.flows = {runs / "ss_flow_solo", runs / "slat_flow_control"};
    test::make_rig_flow(request_.flows.structure, "AniGenSparseStructureLatent", {{"p_given_shape", 1.0}});
    test::make_rig_flow(request_.flows.latents, "AniGenSLat", Json::object());
  }

  static io::RiggedShape ball(double scale = 1.0, const Eigen::Vector3f& offset = Eigen::Vector3f::Zero()) {
    io::RiggedShape shape;
    shape.id = shape.file = "ball";
    const Mesh sphere = geometry::icosphere(2, 0.5);
    for (const Eigen::Vector3f& vertex : sphere.vertices)
      shape.mesh.vertices.push_back(static_cast<float>(scale) * vertex.cwiseProduct(Eigen::Vector3f(1, 0.6F, 0.8F)) +
                                    offset);
    shape.mesh.faces = sphere.faces;
    return shape;
  }

  test::TemporaryFolder folder_;
  FieldRigger::Request request_;
};

TEST_F(FieldRiggerTest, FindsATreeOfJointsThatTheSeedDecides) {
  FieldRigger rigger(request_);
  const Skeleton first = rigger.find(ball()).skeleton;
  ASSERT_GE(first.size(), 1u);
  EXPECT_EQ(first.parents.front(), -1);
  EXPECT_EQ(std::count(first.parents.begin(), first.parents.end(), -1), 1);
  rigger.find(ball(2.0, {1, 2, 3}));
  EXPECT_EQ(rigger.find(ball()).skeleton.positions(), first.positions()) << "what came before must not matter";
}

TEST_F(FieldRiggerTest, AnswersInTheFrameOfTheMesh) {
  FieldRigger rigger(request_);
  const std::vector<Eigen::Vector3d> joints = rigger.find(ball()).skeleton.positions(),
                                     moved = rigger.find(ball(4.0, {8, -2, 1})).skeleton.positions();
  ASSERT_EQ(joints.size(), moved.size());
  // Untrained votes for parents decide the order of the joints, which a rounding may change.
  for (const Eigen::Vector3d& joint : joints) {
    double nearest = 1e9;
    for (const Eigen::Vector3d& other : moved)
      nearest = std::min(nearest, (4.0 * joint + Eigen::Vector3d(8, -2, 1) - other).norm());
    EXPECT_LT(nearest, 1e-5);
  }
}

TEST_F(FieldRiggerTest, AShapeAndItsMirrorImageHaveMirroredSkeletons) {
  io::RiggedShape shape = ball(), mirrored = ball();
  for (Eigen::Vector3f& vertex : shape.mesh.vertices) vertex.z() += 0.3F * std::max(0.0F, vertex.x());
  mirrored.mesh.vertices = shape.mesh.vertices;
  for (Eigen::Vector3f& vertex : mirrored.mesh.vertices) vertex.x() = -vertex.x();
  FieldRigger rigger(request_);
  const FieldRigger::Found one = rigger.find(shape), other = rigger.find(mirrored);
  EXPECT_NEAR(one.agreement, other.agreement, 0.05) << "but for voxels that the mirror image only touches";
  EXPECT_GE(one.agreement, 0.0);
  EXPECT_LE(one.agreement, 1.0);
}

TEST_F(FieldRiggerTest, ItsGroupingIsFittedToVotesInMeshes) {
  fs::create_directories(folder_ / "rigs");
  test::write_glb(folder_ / "rigs/one.glb", test::RigFile());
  write_file_atomically(folder_ / "split.txt", "one\n");
  GroupingRequest request;
  request.ss_flow = request_.flows.structure;
  request.slat_flow = request_.flows.latents;
  request.data = folder_ / "rigs";
  request.splits = {folder_ / "split.txt"};
  EXPECT_TRUE(is_rig_flow(request.slat_flow));
  const GroupingFit fit = fit_grouping(request);
  EXPECT_EQ(fit.assets, 1u);
  const Json written = read_json(request_.flows.latents / "grouping.json");
  EXPECT_EQ(written.at("bandwidth"), fit.rows.front().bandwidth);
  EXPECT_EQ(written.at("least_votes"), fit.rows.front().least_votes);
}

TEST_F(FieldRiggerTest, RefusesFlowsOfPicturesAndOfShapesThatAreNotGiven) {
  const auto message = [&] {
    try {
      FieldRigger rigger(request_);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  test::make_rig_flow(request_.flows.structure, "AniGenSparseStructureLatent", {{"p_given_shape", 0.5}});
  EXPECT_NE(message().find("p_given_shape"), std::string::npos) << message();
  test::make_rig_flow(request_.flows.structure, "ImageConditionedAniGenSparseStructureLatent",
                      {{"p_given_shape", 1.0}});
  EXPECT_NE(message().find("trained with pictures"), std::string::npos) << message();
  io::RiggedShape nothing;
  nothing.file = "nothing.glb";
  test::make_rig_flow(request_.flows.structure, "AniGenSparseStructureLatent", {{"p_given_shape", 1.0}});
  EXPECT_THROW(FieldRigger(request_).find(nothing), InputError);
}

}  // namespace
}  // namespace anigen::generate
