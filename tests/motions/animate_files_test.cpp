#include "anigen/motions/animate_files.h"

#include <gtest/gtest.h>
#include <cmath>
#include <fstream>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/motions/made_bodies.h"
#include "tests/support/paths.h"

namespace anigen::motions {

namespace {

namespace fs = std::filesystem;

std::vector<std::string> clip_names(const fs::path& file) {
  std::vector<std::string> names;
  for (const Animation& clip : io::read_gltf(file).asset.animations) names.push_back(clip.name);
  return names;
}

TEST(AnimateFiles, AddsClipsBehindThoseOfTheFile) {
  const test::TemporaryFolder folder;
  io::write_gltf(folder / "walker.glb", test::made_quadruped());
  AnimateRequest request;
  request.assets = folder / "walker.glb";
  request.out = folder / "once.glb";
  const std::vector<AnimateReport> first = animate_files(request);
  ASSERT_EQ(first.size(), 1U);
  EXPECT_TRUE(first[0].failure.empty()) << first[0].failure;
  EXPECT_TRUE(first[0].copied);
  EXPECT_EQ(clip_names(request.out), std::vector<std::string>{"idle"});

  request.assets = folder / "once.glb";
  request.out = folder / "twice.glb";
  request.motions = {"walk", "idle", (folder / "once.glb").string() + "#idle"};
  animate_files(request);
  EXPECT_EQ(clip_names(request.out), (std::vector<std::string>{"idle", "walk", "idle_2", "idle_3"}));
  request.keep_clips = false;
  request.motions = {"wag"};
  request.out = folder / "anew.glb";
  animate_files(request);
  EXPECT_EQ(clip_names(request.out), std::vector<std::string>{"wag"});
}

TEST(AnimateFiles, SaysWhatANewFileLosesAndKeepsNamesApart) {
  const test::TemporaryFolder folder;
  io::write_gltf(folder / "walker.glb", test::made_quadruped());
  AnimateRequest request;
  request.assets = folder / "walker.glb";
  request.out = folder / "walker.fbx";
  const std::vector<AnimateReport> first = animate_files(request);
  EXPECT_FALSE(first[0].copied);
  EXPECT_NE(to_text(first).find("base colour alone"), std::string::npos);
  request.assets = folder / "walker.fbx";
  request.out = folder / "again.glb";
  EXPECT_TRUE(animate_files(request)[0].failure.empty());
  EXPECT_EQ(clip_names(request.out), (std::vector<std::string>{"idle", "idle_2"}));
}

TEST(AnimateFiles, FolderToFolderAndWhatFailsIsTold) {
  const test::TemporaryFolder folder;
  fs::create_directories(folder / "in/deep");
  io::write_gltf(folder / "in/deep/snake.glb", test::made_snake());
  io::write_gltf(folder / "in/biped.glb", test::made_biped());
  AnimateRequest request;
  request.assets = folder / "in";
  request.out = folder / "out";
  request.motions = {"walk"};
  request.t_pose = true;
  request.out = folder / "out.glb";
  EXPECT_THROW(animate_files(request), InputError);
  request.out = folder / "out";
  const std::vector<AnimateReport> reports = animate_files(request);
  ASSERT_EQ(reports.size(), 2U);
  EXPECT_TRUE(fs::exists(folder / "out/biped.glb"));
  EXPECT_FALSE(fs::exists(folder / "out/deep/snake.glb"));
  EXPECT_EQ(clip_names(folder / "out/biped.glb"), (std::vector<std::string>{"T-pose", "walk"}));
  EXPECT_NE(to_text(reports).find("two arms"), std::string::npos);
  EXPECT_EQ(to_json(reports)["assets"].size(), 2U);
}

TEST(AnimateFiles, RefusesBadInput) {
  const test::TemporaryFolder folder;
  io::write_gltf(folder / "biped.glb", test::made_biped());
  std::ofstream(folder / "broken.glb") << "no glTF";
  AnimateRequest request;
  request.assets = folder / "biped.glb";
  request.out = folder / "biped.glb";
  EXPECT_THROW(animate_files(request), InputError);  // would replace its input
  fs::copy_file(folder / "biped.glb", folder / "a#b.glb");
  request.motions = {(folder / "a#b.glb").string()};
  request.out = folder / "a#b.glb";
  EXPECT_THROW(animate_files(request), InputError) << "a motion is an input, too";
  request.out = folder / "out.glb";
  request.motions = {"gallop"};
  EXPECT_THROW(animate_files(request), InputError);
  request.motions = {"none.bvh"};
  EXPECT_THROW(animate_files(request), InputError);
  request.motions = {"fly"};
  EXPECT_FALSE(animate_files(request).front().failure.empty());
  request.motions = {};
  request.assets = folder / "broken.glb";
  EXPECT_FALSE(animate_files(request).front().failure.empty());
  request.assets = folder / "nothing";
  EXPECT_FALSE(animate_files(request).front().failure.empty());
  EXPECT_FALSE(fs::exists(folder / "out.glb"));
}

TEST(AnimateFiles, ClipsOfAnAssetHaveNamesOfTheirOwn) {
  Asset biped = test::made_biped();
  biped.animations = clips_of(biped, {"walk"}, {});
  const std::vector<Animation> clips = clips_of(biped, {"walk", "walk"}, {});
  ASSERT_EQ(clips.size(), 2U);
  EXPECT_EQ(clips[0].name, "walk_2");
  EXPECT_EQ(clips[1].name, "walk_3");
}

TEST(AnimateFiles, MotionsOfFilesObeyRatesAndRefuseBadOnes) {
  const test::TemporaryFolder folder;
  Asset biped = test::made_biped();
  biped.animations = clips_of(biped, {"walk"}, {});
  const std::vector<std::string> motion{(folder / "walk.glb").string()};
  io::write_gltf(motion.front(), biped);
  biped.animations.clear();
  MotionOptions slow;
  slow.fps = 40;
  slow.speed = 0.25;
  const Animation clip = clips_of(biped, motion, slow).front();
  EXPECT_NEAR(static_cast<double>(clip.channels.front().times.size()), clip.duration() * slow.fps + 1, 1.5);
  for (const double wrong : {0.0, -1.0, std::nan("")}) {
    MotionOptions rate, speed;
    rate.fps = speed.speed = wrong;
    EXPECT_THROW(clips_of(biped, motion, rate), InputError) << wrong;
    EXPECT_THROW(clips_of(biped, motion, speed), InputError) << wrong;
  }
  MotionOptions one_frame;
  one_frame.frames = 1;
  EXPECT_THROW(clips_of(biped, motion, one_frame), InputError);
}

TEST(AnimateFiles, DrawsASheetOrFrames) {
  const test::TemporaryFolder folder;
  io::write_gltf(folder / "lamp.glb", test::made_lamp());
  AnimateRequest request;
  request.assets = folder / "lamp.glb";
  request.out = folder / "out.glb";
  request.pictures = folder / "sheet.png";
  request.options.frames = 3;
  request.options.speed = 20.0;  // few frames to draw
  animate_files(request);
  EXPECT_TRUE(fs::exists(folder / "sheet.png"));
  request.pictures = folder / "frames";
  animate_files(request);
  EXPECT_TRUE(fs::exists(folder / "frames/0000.png"));
}

TEST(AnimateFiles, ListsWhatABodyCanDoAndWhichClipsThereAre) {
  const test::TemporaryFolder folder;
  io::write_gltf(folder / "snake.glb", test::made_snake());
  const Json found = listing(folder / "snake.glb");
  EXPECT_NE(found["motions"].dump().find("slither"), std::string::npos);
  EXPECT_EQ(found["motions"].dump().find("walk"), std::string::npos);
  EXPECT_NE(listing_text(found).find("wind like a snake"), std::string::npos);
  EXPECT_NE(listing_text(found).find("clips: none"), std::string::npos);
}

}  // namespace

}  // namespace anigen::motions
