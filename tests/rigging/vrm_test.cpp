#include "anigen/rigging/vrm.h"

#include <gtest/gtest.h>
#include <algorithm>
#include <filesystem>
#include <set>
#include <string>

#include "anigen/core/files.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/rigging/rig_meshes.h"
#include "tests/rigging/human_rig.h"
#include "tests/support/parsed_gltf.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::rigging {

namespace {

namespace fs = std::filesystem;
using test::HumanRig;

TEST(Springs, AreChainsThatAreNoLimbs) {
  const HumanRig rig;
  const Asset asset = rig.asset();
  const Humanoid humanoid = find_humanoid(asset.skeleton, rig.weight());
  const std::vector<Spring> springs = find_springs(asset.skeleton, humanoid, asset.mesh, asset.skin);
  ASSERT_EQ(springs.size(), 1u) << "neither twist nor end joints";
  EXPECT_EQ(springs[0].joints, (std::vector<int>{rig.index("tail_1"), rig.index("tail_2"), rig.index("tail_3")}));
  EXPECT_GT(springs[0].radius, 0.005);
  EXPECT_LT(springs[0].radius, 0.1) << "the solid's joints are spheres of 0.02 of its diagonal";
}

class VrmFile : public testing::Test {
 protected:
  VrmFile() {
    request_.method = parse_rigging_method("nearest");
    request_.meshes = folder_ / "person.glb";
    request_.out = folder_ / "out.vrm";
    request_.engine.humanoid = true;
  }

  std::string failure() const { return rig_meshes(request_).meshes.at(0).failure; }
  void save(const HumanRig& rig) const { io::write_gltf(folder_ / "person.glb", rig.asset()); }

  test::TemporaryFolder folder_;
  RigRequest request_;
};

TEST_F(VrmFile, HoldsAllRequiredBonesAndTheSpring) {
  const HumanRig rig;
  save(rig);
  request_.vrm.authors = {"A", "B"};
  for (const bool graft : {true, false}) {
    request_.graft = graft;
    ASSERT_EQ(failure(), "");
    const Json json = test::ParsedGltf(request_.out).json;
    const Json& vrm = json["extensions"]["VRMC_vrm"];
    EXPECT_EQ(vrm["specVersion"], "1.0");
    EXPECT_EQ(vrm["meta"]["name"], "person");
    EXPECT_EQ(vrm["meta"]["authors"], Json({"A", "B"}));
    EXPECT_EQ(vrm["meta"]["licenseUrl"], "https://vrm.dev/licenses/1.0/");
    const std::set<std::string> used = json["extensionsUsed"].get<std::set<std::string>>();
    EXPECT_TRUE(used.count("VRMC_vrm") == 1 && used.count("VRMC_springBone") == 1);
    std::set<std::size_t> nodes;
    for (std::size_t bone = 0; bone < kHumanBones; ++bone) {
      const std::string name = bone_name(bone, NameStyle::kVrm);
      if (is_required(bone)) {
        ASSERT_TRUE(vrm["humanoid"]["humanBones"].contains(name)) << name;
        nodes.insert(vrm["humanoid"]["humanBones"][name]["node"].get<std::size_t>());
      }
    }
    EXPECT_EQ(nodes.size(), 15u) << "each bone has a node of its own";
    const std::size_t hand = vrm["humanoid"]["humanBones"]["leftHand"]["node"].get<std::size_t>();
    EXPECT_EQ(json["nodes"][hand]["name"], "j" + std::to_string(rig.index("l_hand")));
    const Json& joints = json["extensions"]["VRMC_springBone"]["springs"][0]["joints"];
    ASSERT_EQ(joints.size(), 3u);
    EXPECT_EQ(json["nodes"][joints[2]["node"].get<std::size_t>()]["name"], "j" + std::to_string(rig.index("tail_3")));
    EXPECT_TRUE(validate(io::read_gltf(request_.out).asset).empty());
  }
}

// The bones are nodes of the grafted skeleton where the tree had to change.
TEST_F(VrmFile, LimbsOfIkRigsHangOnTheBody) {
  HumanRig rig;
  rig["l_foot"].parent = rig["r_foot"].parent = "root";
  save(rig);
  ASSERT_EQ(failure(), "");
  const Json json = test::ParsedGltf(request_.out).json;
  const Json& bones = json["extensions"]["VRMC_vrm"]["humanoid"]["humanBones"];
  const Json& knee = json["nodes"][bones["leftLowerLeg"]["node"].get<std::size_t>()];
  const Json children = knee["children"];
  EXPECT_NE(std::find(children.begin(), children.end(), bones["leftFoot"]["node"]), children.end());
}

TEST_F(VrmFile, WrittenAnewLeavesClipsOutWithAWord) {
  Asset person = HumanRig().asset();
  person.animations = {
      {"bow", {{1, ChannelPath::kRotation, Interpolation::kLinear, {0.0, 0.5}, {0, 0, 0, 1, 0.6, 0, 0, 0.8}}}}};
  io::write_gltf(folder_ / "person.glb", person);
  request_.graft = false;
  const RigReport report = rig_meshes(request_).meshes.at(0);
  EXPECT_EQ(report.failure, "");
  EXPECT_NE(report.note.find("1 clip left out: a .vrm written anew has none"), std::string::npos) << report.note;
  EXPECT_TRUE(io::read_gltf(request_.out).asset.animations.empty());
}

TEST_F(VrmFile, RefusesOthersBeforeAnythingIsWritten) {
  HumanRig rig;
  save(rig);
  request_.meshes = folder_.path();
  EXPECT_NE(test::refusal([&] { rig_meshes(request_); }).find("one mesh"), std::string::npos);
  request_.meshes = folder_ / "person.glb";
  request_.method = parse_rigging_method("nearest", "none");
  EXPECT_NE(test::refusal([&] { rig_meshes(request_); }).find("weights"), std::string::npos);
  request_.method = parse_rigging_method("nearest");
  rig.joints.resize(7);  // trunk and head
  save(rig);
  EXPECT_NE(failure().find("leftUpperArm"), std::string::npos);
  EXPECT_FALSE(fs::exists(request_.out));
}

}  // namespace

}  // namespace anigen::rigging
