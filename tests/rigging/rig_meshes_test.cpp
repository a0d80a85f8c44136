#include <gtest/gtest.h>
#include <new>
#include <stdexcept>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/creatures/body.h"
#include "anigen/curve_skeleton/contraction.h"
#include "anigen/geometry/primitives.h"
#include "anigen/io/gltf/container.h"
#include "anigen/io/gltf/export.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/ply.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "anigen/rigging/rig_meshes.h"
#include "tests/rigging/embedding_bodies.h"
#include "tests/support/hinged_boxes.h"
#include "tests/support/parsed_gltf.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::rigging {

namespace {

namespace fs = std::filesystem;
using test::RigFile;

class RigMeshes : public testing::Test {
 protected:
  RigMeshes() {
    RigFile low = rig_, high = rig_;
    for (std::size_t i = 2; i < low.joints.size(); i += 3) {
      low.joints[i] -= 0.3;
      high.joints[i] += 0.4;
    }
    fs::create_directories(folder_ / "rigs");
    fs::create_directories(folder_ / "meshes/deep");
    test::write_glb(folder_ / "rigs/low.glb", low);
    test::write_glb(folder_ / "rigs/middle.glb", rig_);
    test::write_glb(folder_ / "rigs/high.glb", high);
    RigFile large = rig_;
    for (float& x : large.vertices) x = 2.0F * x + 1.0F;
    test::write_glb(folder_ / "meshes/deep/large.glb", large);
    test::write_glb(folder_ / "meshes/same.glb", rig_);
    request_.meshes = folder_ / "meshes";
    request_.method = parse_rigging_method("template");
    request_.joints.collection = folder_ / "rigs";
    request_.out = folder_ / "out";
  }

  test::TemporaryFolder folder_;
  const RigFile rig_;
  RigRequest request_;
};

TEST_F(RigMeshes, PlaceTheMiddleSkeletonInEveryBox) {
  const RigReports reports = rig_meshes(request_);
  EXPECT_EQ(reports.skeleton, "middle");
  ASSERT_EQ(reports.meshes.size(), 2u);
  for (const RigReport& report : reports.meshes) {
    EXPECT_EQ(report.failure, "");
    const Asset asset = io::read_gltf(report.file).asset;
    EXPECT_TRUE(validate(asset).empty());
    EXPECT_EQ(asset.skeleton.size(), static_cast<std::size_t>(rig_.joint_count()));
    EXPECT_EQ(asset.skin.largest_row(), 1u);
    const double scale = report.id == "same" ? 1.0 : 2.0, offset = report.id == "same" ? 0.0 : 1.0;
    const auto joints = asset.skeleton.positions();
    for (std::size_t j = 0; j < joints.size(); ++j) {
      const Eigen::Vector3d expected(rig_.joints[3 * j], rig_.joints[3 * j + 1], rig_.joints[3 * j + 2]);
      EXPECT_LT((joints[j] - (scale * expected + Eigen::Vector3d::Constant(offset))).norm(), 1e-5);
    }
  }
  EXPECT_TRUE(fs::exists(folder_ / "out/deep/large.glb"));
  EXPECT_EQ(to_json(reports)["meshes"].size(), 2u);
}

TEST_F(RigMeshes, ASplitChoosesTheSkeletons) {
  write_file_atomically(folder_ / "split.txt", "high\n");
  request_.joints.splits = {folder_ / "split.txt"};
  EXPECT_EQ(rig_meshes(request_).skeleton, "high");
}

TEST_F(RigMeshes, ASplitChoosesTheMeshes) {
  write_file_atomically(folder_ / "split.txt", "same\n");
  request_.splits = {folder_ / "split.txt"};
  const RigReports reports = rig_meshes(request_);
  ASSERT_EQ(reports.meshes.size(), 1u);
  EXPECT_EQ(reports.meshes[0].id, "same");
  write_file_atomically(folder_ / "split.txt", "nobody\n");
  EXPECT_THROW(rig_meshes(request_), InputError);
}

TEST_F(RigMeshes, OneFileForOneFile) {
  request_.meshes = folder_ / "meshes/same.glb";
  request_.out = folder_ / "one.glb";
  rig_meshes(request_);
  EXPECT_TRUE(fs::is_regular_file(folder_ / "one.glb"));
}

TEST_F(RigMeshes, SeveralDoNotGoIntoOneFile) {
  request_.out = folder_ / "all.glb";
  EXPECT_THROW(rig_meshes(request_), InputError);
  EXPECT_FALSE(fs::exists(request_.out));
  fs::create_directory(request_.out);  // a folder may be called so
  EXPECT_EQ(rig_meshes(request_).meshes.at(0).failure, "");
}

TEST_F(RigMeshes, TheExtensionChoosesTheFormat) {
  request_.meshes = folder_ / "meshes/same.glb";
  request_.method = parse_rigging_method("nearest");
  for (const char* const name : {"one.fbx", "one.usdz", "one.usda"}) {
    request_.out = folder_ / name;
    EXPECT_EQ(rig_meshes(request_).meshes.at(0).failure, "") << name;
    EXPECT_TRUE(fs::exists(request_.out)) << name;
  }
  const io::RiggedShape shape = io::read_scene_shape(folder_ / "one.fbx", "one");
  EXPECT_EQ(shape.joints.size(), static_cast<std::size_t>(rig_.joint_count()));
  EXPECT_EQ(3 * shape.mesh.vertices.size(), rig_.vertices.size());
  request_.out = folder_ / "one.obj";
  EXPECT_THROW(rig_meshes(request_), InputError);
  EXPECT_FALSE(fs::exists(request_.out));
}

TEST_F(RigMeshes, FilesInAFolderHaveTheFormatAskedFor) {
  request_.format = "fbx";
  for (const RigReport& report : rig_meshes(request_).meshes) EXPECT_EQ(report.failure, "");
  EXPECT_TRUE(fs::exists(folder_ / "out/deep/large.fbx"));
  EXPECT_TRUE(fs::exists(folder_ / "out/same.fbx"));
  request_.format = "obj";
  EXPECT_THROW(rig_meshes(request_), InputError);
}

TEST_F(RigMeshes, OwnJointsKeepTheirClipsInOtherFormats) {
  Asset moving = io::read_gltf(folder_ / "meshes/same.glb").asset;
  Channel turn{0, ChannelPath::kRotation, Interpolation::kLinear, {0.0, 0.5}, {0, 0, 0, 1, 0, 0, 0.6, 0.8}};
  moving.animations = {{"turn", {turn}}};
  io::write_gltf(folder_ / "moving.glb", moving);
  request_.meshes = folder_ / "moving.glb";
  request_.method = parse_rigging_method("nearest");
  for (const io::Axes axes : {io::Axes::kFormat, io::Axes::kZUp}) {
    request_.axes = axes;
    request_.out = folder_ / "moving.fbx";
    EXPECT_EQ(rig_meshes(request_).meshes.at(0).failure, "");
    const io::RiggedShape shape = io::read_scene_shape(request_.out, "moving");
    ASSERT_NE(shape.clips, nullptr);
    ASSERT_EQ(shape.clips->animations.size(), 1u);
    EXPECT_EQ(shape.clips->animations[0].name, "turn");
    EXPECT_NEAR(shape.clips->animations[0].duration(), 0.5, 1e-6);
  }
}

TEST_F(RigMeshes, ABrokenMeshIsReportedAndTheOthersAreRigged) {
  write_file_atomically(folder_ / "meshes/broken.glb", "glTF");
  const RigReports reports = rig_meshes(request_);
  ASSERT_EQ(reports.meshes.size(), 3u);
  EXPECT_NE(reports.meshes[0].failure, "");
  EXPECT_FALSE(fs::exists(reports.meshes[0].file));
  EXPECT_NE(to_text(reports).find("broken: "), std::string::npos);
  EXPECT_EQ(reports.meshes[1].failure + reports.meshes[2].failure, "");
}

TEST_F(RigMeshes, AnIdThatLeavesTheFolderIsRefused) {
  RigFile leaving = rig_, absolute = rig_;
  leaving.uuid = "../leaving";
  absolute.uuid = (folder_ / "absolute").string();
  test::write_articulation_xl(folder_ / "samples.npz", {leaving, absolute, rig_});
  request_.meshes = folder_ / "samples.npz";
  const RigReports reports = rig_meshes(request_);
  ASSERT_EQ(reports.meshes.size(), 3u);
  for (const RigReport& report : reports.meshes) EXPECT_EQ(report.failure.empty(), report.id == rig_.uuid) << report.id;
  EXPECT_FALSE(fs::exists(folder_ / "leaving.glb"));
  EXPECT_FALSE(fs::exists(folder_ / "absolute.glb"));
  EXPECT_TRUE(fs::exists(folder_ / "out" / (rig_.uuid + ".glb")));
}

// Before, the mesh was replaced by its rigged copy without a word.
TEST_F(RigMeshes, AResultThatWouldReplaceAnInputIsRefused) {
  const fs::path mesh = folder_ / "meshes/same.glb", skeleton = folder_ / "rigs/high.glb";
  const std::string before = read_file(mesh), joints = read_file(skeleton);
  fs::create_symlink(mesh, folder_ / "link.glb");
  request_.method = parse_rigging_method("nearest");
  request_.joints = {};
  request_.joints.skeleton = skeleton;
  request_.meshes = mesh;
  for (const fs::path& out : {mesh, folder_ / "meshes/../meshes/same.glb", folder_ / "link.glb", skeleton}) {
    request_.out = out;
    EXPECT_THROW(rig_meshes(request_), InputError) << out;
  }
  request_.meshes = folder_ / "meshes";
  request_.out = folder_ / "meshes";
  EXPECT_THROW(rig_meshes(request_), InputError);
  EXPECT_EQ(read_file(mesh), before);
  EXPECT_EQ(read_file(skeleton), joints);
  EXPECT_TRUE(fs::is_symlink(folder_ / "link.glb"));

  request_.method = parse_rigging_method("template");
  request_.joints.collection = folder_ / "rigs";
  request_.meshes = mesh;
  request_.out = folder_ / "rigs/middle.glb";
  EXPECT_THROW(rig_meshes(request_), InputError) << "a file of the collection";
  request_.out = folder_ / "out/new.glb";
  EXPECT_EQ(rig_meshes(request_).meshes.at(0).failure, "");
  EXPECT_EQ(rig_meshes(request_).meshes.at(0).failure, "") << "its own result may be made again";
}

TEST_F(RigMeshes, APictureMustNotReplaceATexture) {
  write_file_atomically(folder_ / "obj/bare.obj", "mtllib bare.mtl\n" + test::obj_text(rig_));
  write_file_atomically(folder_ / "obj/bare.mtl", "newmtl skin\nmap_Kd bare.png\n");
  write_file_atomically(folder_ / "obj/bare.png", "a texture");
  request_.meshes = folder_ / "obj/bare.obj";
  request_.out = folder_ / "obj/bare.glb";
  request_.also_writes = ".png";
  request_.also = [](const Asset&, fs::path file) { write_file_atomically(file.replace_extension(".png"), "drawn"); };
  EXPECT_THROW(rig_meshes(request_), InputError);
  EXPECT_EQ(read_file(folder_ / "obj/bare.png"), "a texture");
  request_.out = folder_ / "obj/rigged.glb";
  EXPECT_EQ(rig_meshes(request_).meshes.at(0).failure, "");
  EXPECT_EQ(rig_meshes(request_).meshes.at(0).failure, "") << "its own picture may be drawn again";
}

// Of one mesh: memory, LibTorch, OpenCV; the others go on.
TEST_F(RigMeshes, WhateverOneMeshThrowsIsItsFailure) {
  request_.learned.propose = [](const io::RiggedShape& shape, const JointProposer& otherwise) {
    if (shape.id == "same") throw std::bad_alloc();
    return otherwise.propose(shape);
  };
  RigReports reports = rig_meshes(request_);
  ASSERT_EQ(reports.meshes.size(), 2u);
  EXPECT_EQ(reports.meshes[0].failure, "");
  EXPECT_EQ(reports.meshes[1].failure, "out of memory");
  EXPECT_NE(to_text(reports).find("same: out of memory"), std::string::npos);
  request_.also = [](const Asset&, const fs::path& file) {
    if (file.stem() == "large") throw std::runtime_error("(-215:Assertion failed) in function 'x'\n");
  };
  request_.learned = {};
  reports = rig_meshes(request_);
  EXPECT_EQ(reports.meshes[0].failure, "(-215:Assertion failed) in function 'x'");
  EXPECT_EQ(reports.meshes[1].failure, "");
  request_.also = [](const Asset&, const fs::path&) { throw Interrupted("stopped"); };
  EXPECT_THROW(rig_meshes(request_), Interrupted);
  request_.also = [](const Asset&, const fs::path&) { throw WriteError("disk full"); };
  EXPECT_THROW(rig_meshes(request_), WriteError) << "no mesh after it could be written";
}

TEST_F(RigMeshes, GivenJointsAreTheFilesOrAnotherFiles) {
  for (const char* method : {"nearest", "geovoxel", "heat"}) {
    request_.method = parse_rigging_method(method);
    request_.joints = {};
    request_.meshes = folder_ / "meshes/same.glb";
    request_.out = folder_ / "own.glb";
    EXPECT_EQ(rig_meshes(request_).meshes.at(0).failure, "") << method;
    const Asset own = io::read_gltf(folder_ / "own.glb").asset;
    EXPECT_TRUE(validate(own).empty()) << method;
    EXPECT_EQ(own.skeleton.size(), static_cast<std::size_t>(rig_.joint_count()));

    request_.joints.skeleton = folder_ / "rigs/high.glb";
    EXPECT_EQ(rig_meshes(request_).meshes.at(0).failure, "") << method;
    const Asset other = io::read_gltf(folder_ / "own.glb").asset;
    EXPECT_NEAR(other.skeleton.positions()[0].z(), own.skeleton.positions()[0].z() + 0.4, 1e-5) << method;
  }
}

TEST_F(RigMeshes, AGlbKeepsWhatIsNoRig) {
  const fs::path mesh = folder_ / "meshes/same.glb", out = folder_ / "one.glb";
  test::ParsedGltf marked(mesh);
  marked.json["extras"] = "kept";
  write_file_atomically(mesh, io::gltf_import::glb_bytes(marked.json.dump(), marked.binary, mesh.string()));
  request_.meshes = mesh;
  request_.out = out;
  for (const bool graft : {true, false}) {
    request_.graft = graft;
    EXPECT_EQ(rig_meshes(request_).meshes.at(0).failure, "");
    const test::ParsedGltf written(out);
    EXPECT_EQ(written.json.contains("extras"), graft);
    EXPECT_EQ(written.binary.rfind(marked.binary, 0) == 0, graft);
    EXPECT_EQ(io::read_gltf(out).asset.skeleton.size(), static_cast<std::size_t>(rig_.joint_count()));
  }
  // Of the file's own joints only the weights are new, however the mesh was turned for rigging.
  request_.method = parse_rigging_method("nearest");
  request_.joints = {};
  request_.graft = true;
  for (const io::Axes axes : {io::Axes::kFormat, io::Axes::kZUp}) {
    request_.axes = axes;
    EXPECT_EQ(rig_meshes(request_).meshes.at(0).failure, "");
    EXPECT_EQ(test::ParsedGltf(out).json["nodes"], marked.json["nodes"]);
    EXPECT_EQ(test::ParsedGltf(out).json["skins"], marked.json["skins"]);
  }
}

TEST_F(RigMeshes, NewJointsHaveNoRotationInTheFile) {
  request_.meshes = folder_ / "meshes/same.glb";
  request_.out = folder_ / "one.glb";
  const Asset before = io::read_gltf(request_.meshes).asset;
  for (const bool graft : {true, false}) {
    for (const io::Axes axes : {io::Axes::kFormat, io::Axes::kZUp}) {
      request_.graft = graft;
      request_.axes = axes;
      EXPECT_EQ(rig_meshes(request_).meshes.at(0).failure, "");
      const test::ParsedGltf written(request_.out);
      for (const Json& joint : written.json["skins"][0]["joints"]) {
        const auto q = written.json["nodes"][joint.get<std::size_t>()]["rotation"].get<std::vector<double>>();
        EXPECT_EQ(std::abs(q[0]) + std::abs(q[1]) + std::abs(q[2]), 0.0) << graft << " " << io::name_of(axes);
      }
      const Asset after = io::read_gltf(request_.out).asset;
      const std::vector<Eigen::Vector3f> rested =
          skin_vertices(after, forward_kinematics(after.skeleton.parents, after.skeleton.rest));
      ASSERT_EQ(rested.size(), before.mesh.vertices.size());
      for (std::size_t v = 0; v < rested.size() && axes == io::Axes::kFormat; ++v)
        ASSERT_LE((rested[v] - before.mesh.vertices[v]).norm(), 1e-6F) << "vertex " << v;
    }
  }
}

TEST_F(RigMeshes, AMeshThatCannotBeGraftedSaysWhatElseCanBeDone) {
  const fs::path mesh = folder_ / "meshes/same.glb";
  test::ParsedGltf marked(mesh);
  for (Json& node : marked.json["nodes"]) {
    if (node.contains("mesh")) node["extensions"]["EXT_mesh_gpu_instancing"] = Json::object();
  }
  write_file_atomically(mesh, io::gltf_import::glb_bytes(marked.json.dump(), marked.binary, mesh.string()));
  request_.meshes = mesh;
  request_.out = folder_ / "one.glb";
  const std::string failure = rig_meshes(request_).meshes.at(0).failure;
  EXPECT_NE(failure.find("/nodes/"), std::string::npos) << failure;
  EXPECT_NE(failure.find("--no-graft"), std::string::npos) << failure;
  EXPECT_FALSE(fs::exists(request_.out));
}

TEST_F(RigMeshes, AMeshWithoutJointsIsRefusedByBindingsAlone) {
  write_file_atomically(folder_ / "bare.obj", test::obj_text(rig_));
  request_.method = parse_rigging_method("geovoxel");
  request_.joints = {};
  request_.meshes = folder_ / "bare.obj";
  request_.out = folder_ / "rigged.glb";
  EXPECT_NE(rig_meshes(request_).meshes.at(0).failure.find("holds no skeleton to bind to"), std::string::npos);
  EXPECT_FALSE(fs::exists(folder_ / "rigged.glb"));
}

TEST_F(RigMeshes, WithoutAMethodOwnJointsStayAndOthersAreFound) {
  request_.method = parse_rigging_method("auto");
  EXPECT_EQ(request_.method.binding, SkinBinding::kHeat);
  request_.joints = {};
  RigReports reports = rig_meshes(request_);
  for (const RigReport& report : reports.meshes) {
    EXPECT_EQ(report.failure, "");
    EXPECT_EQ(report.note, "keeps its own joints");
    EXPECT_EQ(report.joints, static_cast<std::size_t>(rig_.joint_count()));
  }
  request_.joints.keep_skeleton = false;
  for (const RigReport& report : rig_meshes(request_).meshes) {
    EXPECT_EQ(report.failure, "");
    EXPECT_TRUE(report.note.find("template") != std::string::npos) << report.note;
    const Asset asset = io::read_gltf(report.file).asset;
    EXPECT_TRUE(validate(asset).empty());
    EXPECT_GE(asset.skeleton.size(), 2u);
  }
  request_.joints.skeleton = folder_ / "rigs/high.glb";
  request_.meshes = folder_ / "meshes/same.glb";
  request_.out = folder_ / "high.glb";
  EXPECT_EQ(rig_meshes(request_).meshes.front().note, "joints of high.glb");
}

TEST_F(RigMeshes, WhereNoTemplateFitsLearnedJointsGoBeforeTheCurve) {
  Mesh rod = geometry::icosphere(3, 1.0);
  for (Eigen::Vector3f& vertex : rod.vertices) vertex = vertex.cwiseProduct(Eigen::Vector3f(1.0F, 0.04F, 0.04F));
  io::write_ply(folder_ / "rod.ply", rod);
  request_.method = parse_rigging_method("auto");
  request_.joints = {};
  request_.joints.templates_first = true;
  request_.meshes = folder_ / "rod.ply";
  request_.out = folder_ / "rigged.glb";
  bool knows = true;
  request_.joints.learned = [&](const io::RiggedShape& shape, std::string& why_not) -> std::optional<ProposedJoints> {
    EXPECT_TRUE(shape.has_surface());
    why_not = "never seen a rod";
    if (!knows) return std::nullopt;
    return ProposedJoints{skeleton_from_joints({{0, 0, 0}, {0, 0, 1}}, {-1, 0}), "learned"};
  };
  RigReport report = rig_meshes(request_).meshes.at(0);
  EXPECT_EQ(report.failure, "");
  EXPECT_EQ(report.joints, 2u);
  EXPECT_EQ(report.note.rfind("learned, since ", 0), 0u) << report.note;
  knows = false;
  report = rig_meshes(request_).meshes.at(0);
  EXPECT_EQ(report.failure, "");
  EXPECT_NE(report.note.find("never seen a rod"), std::string::npos) << report.note;
  EXPECT_EQ(report.note.rfind("curve, since ", 0), 0u) << report.note;
}

TEST_F(RigMeshes, LearnedJointsGoBeforeATemplateThatFits) {
  const Asset man = creatures::make_creature("biped", 5, 1);
  io::write_ply(folder_ / "man.ply", man.mesh);
  request_.method = parse_rigging_method("auto");
  request_.joints = {};
  request_.meshes = folder_ / "man.ply";
  request_.out = folder_ / "rigged.glb";
  const auto note = [&] { return rig_meshes(request_).meshes.at(0).note; };
  ASSERT_NE(note().find(" fits: "), std::string::npos) << note();
  request_.joints.learned = [&](const io::RiggedShape&, std::string&) -> std::optional<ProposedJoints> {
    return ProposedJoints{skeleton_from_joints({{0, 0, 0}, {0, 0, 1}}, {-1, 0}), "learned"};
  };
  EXPECT_EQ(note(), "learned");
  request_.joints.templates_first = true;
  EXPECT_NE(note().find(" fits: "), std::string::npos);
  request_.joints.templates_first = false;
  request_.joints.templates = {"biped"};
  EXPECT_EQ(note().rfind("template biped, ", 0), 0u) << "what is named is taken";
}

TEST_F(RigMeshes, WithoutABindingTheSkeletonAloneIsWritten) {
  request_.method = parse_rigging_method("nearest", "none");
  request_.joints = {};
  request_.meshes = folder_ / "meshes/same.glb";
  request_.out = folder_ / "skeleton.glb";
  std::size_t pictures = 0;
  request_.also = [&](const Asset&, const fs::path& file) { pictures += fs::is_regular_file(file) ? 1 : 0; };
  EXPECT_EQ(rig_meshes(request_).meshes.at(0).failure, "");
  EXPECT_EQ(pictures, 1u);
  const Asset solid = io::read_gltf(folder_ / "skeleton.glb").asset;
  EXPECT_TRUE(validate(solid).empty());
  EXPECT_EQ(solid.skeleton.size(), static_cast<std::size_t>(rig_.joint_count()));
  EXPECT_NE(solid.mesh.vertices.size(), rig_.vertices.size() / 3);
}

TEST_F(RigMeshes, LearnedStepsTakeThePlaceOfTheOthers) {
  request_.method = parse_rigging_method("geovoxel");
  request_.joints = {};
  request_.meshes = folder_ / "meshes/same.glb";
  request_.learned.propose = [](const io::RiggedShape& shape, const JointProposer& otherwise) {
    const std::size_t given = otherwise.propose(shape).skeleton.size();
    return ProposedJoints{skeleton_from_joints({{0, 0, 0}, {0, 0, 1}}, {-1, 0}), std::to_string(given) + " given"};
  };
  request_.learned.bind = [](const io::RiggedShape& shape, const Skeleton& skeleton) {
    return from_dense(std::vector<float>(shape.mesh.vertices.size() * skeleton.size(), 0.5F),
                      shape.mesh.vertices.size(), skeleton.size());
  };
  request_.out = folder_ / "learned.glb";
  const RigReport report = rig_meshes(request_).meshes.at(0);
  EXPECT_EQ(report.failure, "");
  EXPECT_EQ(report.note, std::to_string(rig_.joint_count()) + " given");
  const Asset asset = io::read_gltf(report.file).asset;
  EXPECT_TRUE(validate(asset).empty());
  ASSERT_EQ(asset.skeleton.size(), 2u);
  EXPECT_EQ(asset.skin.largest_row(), 2u);

  request_.learned.bind = [](const io::RiggedShape&, const Skeleton&) -> SkinWeights {
    throw InputError("model", "", "does not know such shapes");
  };
  EXPECT_NE(rig_meshes(request_).meshes.at(0).failure.find("does not know"), std::string::npos);
  request_.method = parse_rigging_method("geovoxel", "none");
  EXPECT_EQ(rig_meshes(request_).meshes.at(0).failure, "") << "nothing is bound for a skeleton alone";
}

TEST_F(RigMeshes, RigidPartsFollowOneJoint) {
  const Asset boxes = test::hinged_boxes(0.01F, 0.3F);
  const fs::path mesh = folder_ / "hinge.glb", out = folder_ / "rigid.glb";
  io::write_gltf(mesh, boxes);
  RigRequest request;
  request.meshes = mesh;
  request.out = out;
  request.method = parse_rigging_method("heat");
  request.learned.bind = [&](const io::RiggedShape&, const Skeleton&) { return boxes.skin; };
  ASSERT_EQ(rig_meshes(request).meshes.at(0).failure, "");
  EXPECT_EQ(io::read_gltf(out).asset.skin.largest_row(), 2u);
  request.rigid_share = kRigidShare;
  const RigReports reports = rig_meshes(request);
  EXPECT_EQ(reports.meshes.at(0).note, "2 of 2 shells rigid, 100 % of the surface");
  EXPECT_EQ(to_json(reports)["meshes"][0]["rigid_parts"][0]["joint"], "base");
  EXPECT_EQ(io::read_gltf(out).asset.skin.largest_row(), 1u);
  request.rigid_share = 0.9;
  EXPECT_EQ(rig_meshes(request).meshes.at(0).note, "0 of 2 shells rigid, 0 % of the surface");
}

TEST(RiggingMethod, WordsAreChecked) {
  for (const std::string& word : rigging_method_words()) EXPECT_NO_THROW(parse_rigging_method(word));
  EXPECT_THROW(parse_rigging_method("magic"), InputError);
  EXPECT_THROW(parse_rigging_method("curve", "magic"), InputError);
  EXPECT_FALSE(parse_rigging_method("curve", "none").binding.has_value());
  EXPECT_EQ(parse_rigging_method("pinocchio", "nearest").binding, SkinBinding::kNearest);
}

TEST_F(RigMeshes, ACollectionWithoutSkeletonsIsRefused) {
  fs::create_directories(folder_ / "nothing");
  write_file_atomically(folder_ / "nothing/broken.glb", "glTF");
  request_.joints.collection = folder_ / "nothing";
  EXPECT_THROW(rig_meshes(request_), InputError);
}

}  // namespace

namespace {

/// A bar with three arms, four units aside for each that came before.
Mesh armed_bars(int count) {
  Mesh mesh;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d at(4.0 * i, 0, 0);
    const auto place = [&](double x, double z) { return Eigen::Vector3d(at + Eigen::Vector3d(x, 0, z)); };
    const Mesh bar = test::capsule_mesh(
        {{place(0, 0), place(0, 2), 0.2}, {place(0, 1), place(0.9, 1), 0.12}, {place(0, 1.9), place(-0.9, 1.9), 0.12}});
    const auto first = static_cast<std::int32_t>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(), bar.vertices.begin(), bar.vertices.end());
    for (const Triangle& face : bar.faces) mesh.faces.push_back({face[0] + first, face[1] + first, face[2] + first});
  }
  return mesh;
}

TEST_F(RigMeshes, AutoRigsBodiesThatStandApartOneByOne) {
  if (!curve_skeleton::can_contract()) GTEST_SKIP() << "not supported: a build without CGAL (ANIGEN_WITH_CGAL)";
  fs::create_directories(folder_ / "bars");
  io::write_ply(folder_ / "bars/one.ply", armed_bars(1));
  io::write_ply(folder_ / "bars/two.ply", armed_bars(2));
  request_.method = parse_rigging_method("auto");
  request_.meshes = folder_ / "bars";
  request_.edits.joints = 7;
  const RigReports reports = rig_meshes(request_);
  ASSERT_EQ(reports.meshes.size(), 2u);
  EXPECT_EQ(reports.meshes[0].failure + reports.meshes[1].failure, "");
  EXPECT_EQ(reports.meshes[0].joints, 7u);
  EXPECT_EQ(reports.meshes[1].joints, 15u);
  EXPECT_NE(reports.meshes[1].note.find("body 2: "), std::string::npos) << reports.meshes[1].note;
  const Asset asset = io::read_gltf(reports.meshes[1].file).asset;
  for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v) {
    const std::string body = asset.mesh.vertices[v].x() < 2.0F ? "body_1_" : "body_2_";
    for (std::size_t i = 0; i < asset.skin.row_size(v); ++i)
      EXPECT_EQ(asset.skeleton.names[static_cast<std::size_t>(asset.skin.row(v)[i].joint)].rfind(body, 0), 0U);
  }
  request_.separate_bodies = false;
  EXPECT_EQ(rig_meshes(request_).meshes[1].joints, 7u);
}

TEST_F(RigMeshes, AddedJointsLeaveTheClipsAsTheyAre) {
  if (!curve_skeleton::can_contract()) GTEST_SKIP() << "not supported: a build without CGAL (ANIGEN_WITH_CGAL)";
  Asset own;
  own.name = "own";
  own.mesh = armed_bars(1);
  own.skeleton = skeleton_from_joints({{0, 0, 0}, {0, 0, 1}, {0, 0, 2}}, {-1, 0, 1}, {"a", "b", "c"});
  for (std::size_t v = 0; v < own.mesh.vertices.size(); ++v) own.skin.append_row({{1, 1.0F}});
  Channel turn;
  turn.joint = 1;
  turn.path = ChannelPath::kRotation;
  turn.times = {0.0, 1.0};
  turn.values = {0, 0, 0, 1, 0, 0.6, 0, 0.8};
  own.animations = {{"wave", {turn}}};
  io::write_gltf(folder_ / "own.glb", own);
  request_.method = parse_rigging_method("auto");
  request_.meshes = folder_ / "own.glb";
  request_.edits.extend = true;
  for (const bool graft : {true, false}) {
    request_.graft = graft;
    request_.out = folder_ / (graft ? "out.glb" : "out.fbx");
    EXPECT_EQ(rig_meshes(request_).meshes[0].failure, "");
    const io::RiggedShape back = io::open_source(request_.out)->read("out");
    EXPECT_GT(back.joints.size(), 4u) << graft;
    ASSERT_NE(back.clips, nullptr) << graft;
    EXPECT_EQ(back.clips->animations.size(), 1u);
  }
}

TEST_F(RigMeshes, JointsAreAddedToASkeletonAlone) {
  if (!curve_skeleton::can_contract()) GTEST_SKIP() << "not supported: a build without CGAL (ANIGEN_WITH_CGAL)";
  io::write_ply(folder_ / "bar.ply", armed_bars(1));
  RigFile own = rig_;
  own.joints = {0, 0, 0, 0, 0, 1, 0, 0, 2};
  test::write_glb(folder_ / "own.glb", own);
  request_.method = parse_rigging_method("auto");
  request_.meshes = folder_ / "bar.ply";
  request_.out = folder_ / "out.glb";
  request_.edits.extend = true;
  EXPECT_NE(rig_meshes(request_).meshes[0].failure.find("no skeleton that joints could be added to"),
            std::string::npos);
  request_.joints.skeleton = folder_ / "own.glb";
  const RigReports reports = rig_meshes(request_);
  EXPECT_EQ(reports.meshes[0].failure, "");
  EXPECT_NE(reports.meshes[0].note.find("joints added"), std::string::npos) << reports.meshes[0].note;
  EXPECT_GT(reports.meshes[0].joints, 4u);
}

}  // namespace

}  // namespace anigen::rigging
