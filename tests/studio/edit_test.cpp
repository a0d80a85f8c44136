#include <gtest/gtest.h>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/random.h"
#include "anigen/creatures/body.h"
#include "anigen/engine/files.h"
#include "anigen/io/mtl.h"
#include "anigen/studio/job_work.h"
#include "anigen/studio/obj_archive.h"
#include "anigen/studio/rebind.h"
#include "anigen/studio/rig_formats.h"
#include "anigen/studio/submission.h"
#include "anigen/studio/weight_strokes.h"
#include "tests/support/hinged_boxes.h"
#include "tests/support/paths.h"

namespace anigen::studio {

namespace {

namespace fs = std::filesystem;

/// Strokes in the plainest way: dense weights, neighbours found by comparing all vertices and faces.
Eigen::MatrixXd painted_slowly(const std::vector<Stroke>& strokes, const Asset& asset, Eigen::MatrixXd weights) {
  const Mesh& mesh = asset.mesh;
  const auto count = static_cast<Eigen::Index>(mesh.vertices.size());
  const auto place = [&](Eigen::Index v) { return mesh.vertices[static_cast<std::size_t>(v)]; };
  for (const Stroke& stroke : strokes) {
    const Eigen::MatrixXd before = weights;
    for (Eigen::Index v = 0; v < count; ++v) {
      const double far = (place(v).cast<double>() - stroke.center).norm() / stroke.radius;
      if (far >= 1.0) continue;
      const double a = stroke.strength * std::pow(1.0 - far * far, 2.0);
      if (stroke.mode == Stroke::Mode::kAdd) {
        weights.row(v) *= 1.0 - a;
        weights(v, stroke.joint) += a;
      } else if (stroke.mode == Stroke::Mode::kRemove) {
        const double own = before(v, stroke.joint), others = 1.0 - own;
        const int parent = asset.skeleton.parents[static_cast<std::size_t>(stroke.joint)];
        if (others > 1e-6) {
          weights.row(v) *= (1.0 - own * (1.0 - a)) / others;
        } else if (parent >= 0) {
          weights(v, parent) += own * a;
        } else {
          continue;
        }
        weights(v, stroke.joint) = own * (1.0 - a);
      } else {
        Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(weights.cols());
        double places = 0.0;
        std::vector<Eigen::Vector3f> seen;
        for (Eigen::Index other = 0; other < count; ++other) {
          bool joined = false;
          for (const Triangle& face : mesh.faces) {
            bool here = false, there = false;
            for (const std::int32_t corner : face) {
              here = here || place(corner) == place(v);
              there = there || place(corner) == place(other);
            }
            joined = joined || (here && there && place(other) != place(v));
          }
          if (!joined || std::find(seen.begin(), seen.end(), place(other)) != seen.end()) continue;
          seen.push_back(place(other));
          Eigen::RowVectorXd mean = Eigen::RowVectorXd::Zero(weights.cols());
          double members = 0.0;
          for (Eigen::Index twin = 0; twin < count; ++twin) {
            if (place(twin) != place(other)) continue;
            mean += before.row(twin);
            members += 1.0;
          }
          sum += mean / members;
          places += 1.0;
        }
        if (places > 0.0) weights.row(v) = (1.0 - a) * before.row(v) + a * sum / places;
      }
    }
  }
  return weights;
}

Eigen::MatrixXd dense_weights(const Asset& asset) {
  const std::vector<float> values = to_dense(asset.skin, asset.skeleton.size());
  Eigen::MatrixXd weights(static_cast<Eigen::Index>(asset.skin.rows()),
                          static_cast<Eigen::Index>(asset.skeleton.size()));
  for (Eigen::Index v = 0; v < weights.rows(); ++v)
    for (Eigen::Index j = 0; j < weights.cols(); ++j)
      weights(v, j) = values[static_cast<std::size_t>(v * weights.cols() + j)];
  return weights;
}

TEST(StudioStrokes, ChangeWeightsAsTheFormulasSay) {
  Rng rng(1, "strokes", 0);
  for (int round = 0; round < 20; ++round) {
    Asset asset = test::hinged_boxes(0.1F, 0.3F);
    std::vector<Stroke> strokes;
    for (int i = 0; i < 6; ++i) {
      Stroke stroke;
      stroke.joint = static_cast<int>(rng.index(3));
      stroke.center = {2.0 * rng.uniform() - 1.0, rng.uniform() - 0.5, rng.uniform() - 0.5};
      stroke.radius = 0.3 + rng.uniform();
      stroke.strength = rng.uniform();
      stroke.mode = static_cast<Stroke::Mode>(rng.index(3));
      strokes.push_back(stroke);
    }
    const Eigen::MatrixXd expected = painted_slowly(strokes, asset, dense_weights(asset));
    apply_strokes(strokes, asset);
    EXPECT_LT((dense_weights(asset) - expected).cwiseAbs().maxCoeff(), 1e-5) << round;  // weights are floats
    EXPECT_TRUE(validate(asset).empty());
  }
}

TEST(StudioStrokes, TakeAllWeightFromAJoint) {
  Asset asset = test::hinged_boxes(0.1F, 0.0F);
  Stroke stroke;
  stroke.joint = 1;
  stroke.center = {1.05, 0.5, 0.5};  // a corner of the lid, which the lid alone moves
  stroke.radius = 1e-3;
  stroke.mode = Stroke::Mode::kRemove;
  apply_strokes({stroke}, asset);
  const Eigen::MatrixXd weights = dense_weights(asset);
  for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v) {
    if ((asset.mesh.vertices[v].cast<double>() - stroke.center).norm() < 1e-3) {
      EXPECT_NEAR(weights(static_cast<Eigen::Index>(v), 0), 1.0, 1e-6) << "its parent has it";
    }
  }
  stroke.joint = 0;
  apply_strokes({stroke}, asset);
  EXPECT_TRUE(validate(asset).empty()) << "a vertex keeps some joint";
}

Json places_of(const Skeleton& skeleton) {
  Json joints = Json::array();
  const std::vector<Eigen::Vector3d> places = skeleton.positions();
  for (std::size_t j = 0; j < places.size(); ++j) {
    joints.push_back({{"name", skeleton.names[j]},
                      {"parent", skeleton.parents[j]},
                      {"position", {places[j].x(), places[j].z(), -places[j].y()}}});
  }
  return joints;
}

TEST(StudioEdits, KeepWeightsByTheNamesOfJoints) {
  const Asset dog = creatures::make_creature("quadruped", 3, 0);
  ASSERT_FALSE(dog.animations.empty());
  Json joints = places_of(dog.skeleton);
  const Asset same = with_kept_weights(dog, skeleton_of_joints(joints)).asset;
  EXPECT_EQ(same.animations.size(), dog.animations.size()) << "the joints are the same";
  EXPECT_EQ(dense_weights(same), dense_weights(dog));
  joints[1]["position"][1] = 9.0;
  const Asset moved = with_kept_weights(dog, skeleton_of_joints(joints)).asset;
  EXPECT_TRUE(moved.animations.empty());
  EXPECT_EQ(moved.skin.rows(), dog.skin.rows());
  joints[1]["name"] = "never_seen";
  EXPECT_THROW(with_kept_weights(dog, skeleton_of_joints(joints)), InputError);
  // Without its last joint, whose weights its parent gets.
  Json fewer = places_of(dog.skeleton);
  const std::size_t last = dog.skeleton.size() - 1;
  fewer.erase(last);
  const Asset less = with_kept_weights(dog, skeleton_of_joints(fewer)).asset;
  ASSERT_EQ(less.skeleton.size(), last);
  const Eigen::MatrixXd had = dense_weights(dog), has = dense_weights(less);
  const auto column = [&](const std::string& name) {
    return std::find(less.skeleton.names.begin(), less.skeleton.names.end(), name) - less.skeleton.names.begin();
  };
  const std::string parent = dog.skeleton.names[static_cast<std::size_t>(dog.skeleton.parents[last])];
  const Eigen::VectorXd both = had.col(dog.skeleton.parents[last]) + had.col(static_cast<Eigen::Index>(last));
  EXPECT_LT((has.col(column(parent)) - both).cwiseAbs().maxCoeff(), 1e-5);
}

TEST(StudioEdits, KeepWeightsOfJointsWithNewNames) {
  const Asset dog = creatures::make_creature("quadruped", 3, 0);
  Json joints = places_of(dog.skeleton);
  joints[2]["was"] = joints[2]["name"];
  joints[2]["name"] = "another";
  const Skeleton now = skeleton_of_joints(joints), former = with_former_names(now, joints);
  EXPECT_TRUE(has_joints(dog, former));
  EXPECT_FALSE(has_joints(dog, now));
  Asset kept = with_kept_weights(dog, former).asset;
  EXPECT_EQ(kept.skeleton.names, dog.skeleton.names);
  rename_joints(former, now.names, kept);
  EXPECT_EQ(kept.skeleton.names[2], "another");
  EXPECT_EQ(kept.skeleton.names[1], dog.skeleton.names[1]);
  EXPECT_EQ(dense_weights(kept), dense_weights(dog));
  joints[3]["was"] = joints[2]["was"];
  EXPECT_THROW(with_former_names(skeleton_of_joints(joints), joints), InputError);
  joints[3]["was"] = 3;
  EXPECT_THROW(skeleton_of_joints(joints), InputError);
}

TEST(StudioEdits, RenameAHumanAndNoDog) {
  const Asset human = creatures::make_creature("biped", 3, 0);
  const Asset named = renamed(human, "mixamo");
  EXPECT_NE(std::find(named.skeleton.names.begin(), named.skeleton.names.end(), "mixamorig:Hips"),
            named.skeleton.names.end());
  EXPECT_EQ(named.animations.size(), human.animations.size()) << "names alone are new";
  EXPECT_TRUE(validate(named).empty());
  const test::TemporaryFolder folder;
  write_rig_file(human, folder / "human.vrm");
  EXPECT_NE(read_file(folder / "human.vrm").find("VRMC_vrm"), std::string::npos);
  const Asset dog = creatures::make_creature("quadruped", 3, 0);
  EXPECT_THROW(renamed(dog, "vrm"), InputError);
  EXPECT_THROW(write_rig_file(dog, folder / "dog.vrm"), InputError);
  EXPECT_FALSE(fs::exists(folder / "dog.vrm"));
  EXPECT_EQ(renamed(dog, "chain").skeleton.names.front().rfind("chain_", 0), 0U);
}

/// Files of a ZIP archive without compression, by the headers before each.
std::map<std::string, std::string> unpacked(const std::string& zip) {
  std::map<std::string, std::string> files;
  const auto number = [&](std::size_t at, int bytes) {
    std::size_t value = 0;
    for (int i = bytes; i-- > 0;)
      value = value << 8 | static_cast<unsigned char>(zip[at + static_cast<std::size_t>(i)]);
    return value;
  };
  for (std::size_t at = 0; zip.compare(at, 4, "PK\x03\x04") == 0;) {
    const std::size_t size = number(at + 18, 4), name = number(at + 26, 2), extra = number(at + 28, 2);
    files[zip.substr(at + 30, name)] = zip.substr(at + 30 + name + extra, size);
    at += 30 + name + extra + size;
  }
  return files;
}

TEST(StudioEdits, ArchiveHasMeshMaterialsAndRig) {
  Asset asset = test::hinged_boxes(0.1F, 0.2F);
  asset.materials.resize(2);
  asset.materials[0].base_color = {0.25F, 0.5F, 1.0F, 0.5F};
  asset.materials[1].image = 0;
  const std::string png = read_file(test::source_dir() / "examples/creatures/deer.png");
  asset.images.push_back({"deer", "image/png", {png.begin(), png.end()}});
  asset.mesh.uvs.resize(asset.mesh.vertices.size(), {0.5F, 0.25F});
  asset.mesh.face_materials.assign(asset.mesh.faces.size(), 0);
  asset.mesh.face_materials.back() = 1;
  asset.mesh.face_materials.front() = -1;
  const test::TemporaryFolder folder;
  write_obj_archive(asset, folder / "hinge.zip");
  for (const auto& [name, bytes] : unpacked(read_file(folder / "hinge.zip")))
    write_file_atomically(folder / name, bytes);
  const io::PaintedMesh read = io::read_painted_obj(folder / "model.obj");
  EXPECT_TRUE(read.notes.empty());
  EXPECT_EQ(read.mesh.faces.size(), asset.mesh.faces.size());
  ASSERT_EQ(read.materials.size(), 3U);
  EXPECT_EQ(read.materials[0].name, "plain");
  EXPECT_TRUE(read.materials[1].base_color.isApprox(asset.materials[0].base_color));
  EXPECT_EQ(read.mesh.face_materials.back(), 2);
  ASSERT_EQ(read.images.size(), 1U);
  EXPECT_EQ(read.images[0].bytes, asset.images[0].bytes);
  const Json rig = Json::parse(read_file(folder / "model.rig.json"));
  EXPECT_EQ(rig.at("joints").size(), 3U);
  EXPECT_EQ(rig.at("skin").size(), asset.mesh.vertices.size());
  std::size_t files = 0;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder.path())) files += entry.exists() ? 1 : 0;
  EXPECT_EQ(files, 5U) << "nothing is left beside the archive and its 4 files";
}

TEST(StudioSubmission, BeginsWithTheVoxelsOfAnotherGeneration) {
  const test::TemporaryFolder folder;
  JobStore store(folder.path());
  const Form first{
      {"file", {"C:\\cat.jpg", "image"}}, {"mask", {"m.png", "mask"}}, {"options", {"", R"({"seed": 7})"}}};
  const Submission made = submission_of("generation", first, store);
  ASSERT_EQ(made.files.size(), 2U);
  const std::string id = store.create(made.record, made.files).id;
  EXPECT_EQ(read_file(store.folder(id) / "input_mask.png"), "mask");
  const Form again{{"options", {"", "{\"voxels_of\": \"" + id + "\", \"seed\": 8}"}}};
  EXPECT_THROW(submission_of("generation", again, store), RequestError) << "it has not ended";
  store.update(id, [](JobRecord& record) { record.state = JobState::kDone; });
  EXPECT_THROW(submission_of("generation", again, store), RequestError) << "it has no voxels";
  write_file_atomically(store.folder(id) / kVoxelsFile, "voxels");
  const Submission second = submission_of("generation", again, store);
  EXPECT_EQ(second.record.source, id);
  EXPECT_EQ(second.record.name, "cat.jpg");
  const std::string next = store.create(second.record, second.files).id;
  EXPECT_EQ(read_file(store.folder(next) / "input.jpg"), "image");
  EXPECT_EQ(read_file(store.folder(next) / "input_mask.png"), "mask");
  EXPECT_EQ(read_file(store.folder(next) / "input_voxels.npz"), "voxels");
  Form own = again;
  own["mask"] = {"n.png", "another mask"};
  EXPECT_EQ(submission_of("generation", own, store).files.back().bytes, "another mask");
  own["file"] = {"dog.png", "another image"};
  EXPECT_EQ(submission_of("generation", own, store).record.name, "dog.png");
  EXPECT_THROW(job_with_rig(store, id), RequestError) << "it stopped at its voxels";
  own["mask"] = {"n.jpg", "no PNG"};
  EXPECT_THROW(submission_of("generation", own, store), InputError);
  const Form both{{"options", {"", "{\"voxels_of\": \"" + id + "\", \"stop_at\": \"voxels\"}"}}};
  EXPECT_THROW(submission_of("generation", both, store), InputError);
  EXPECT_THROW(
      submission_of("generation", {{"file", {"a.png", "x"}}, {"options", {"", R"({"voxels_of": "../x"})"}}}, store),
      RequestError);
}

}  // namespace

}  // namespace anigen::studio
