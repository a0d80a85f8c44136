#include "anigen/generate/video_animation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/write_rigged.h"
#include "anigen/render/dataset_views.h"
#include "tests/support/paths.h"
#include "tests/tracking/bent_chain.h"

namespace anigen::generate {
namespace {

namespace fs = std::filesystem;

// The bar's file, and three frames of it bending further, with their camera, in frames/.
class VideoAnimation : public ::testing::Test {
 protected:
  VideoAnimation() {
    const Asset bar = test::two_bone_bar();
    io::write_rigged(rig, bar, {});
    fs::create_directories(frames);
    render::ViewCamera view;
    view.yaw = -1.3;
    view.pitch = 0.1;
    view.radius = 2.6;
    view.fov = render::kFeatureFov;
    render::ViewOptions options;
    options.size = 64;
    render::Transforms transforms;
    for (std::size_t n = 0; n < 3; ++n) {
      Pose pose = bind_pose(bar.skeleton);
      pose[1].rotation = Eigen::AngleAxisd(0.2 + 0.2 * static_cast<double>(n), Eigen::Vector3d::UnitY());
      const std::string name = std::to_string(n) + ".png";
      transforms.frames.push_back(render::make_frame(view, name));
      const render::Scene scene(bar, skin_vertices(bar, pose));
      io::write_png(frames / name, render::render_view(scene, transforms.frames.back(), options).color);
    }
    render::write_transforms(frames / "transforms.json", transforms);
    request.asset = rig;
    request.video = frames;
    request.out = folder.path() / "moved.glb";
    request.fps = 10.0;
    request.tracking.resolution = 64;
    request.tracking.first_iterations = 50;
    request.tracking.iterations = 20;
    request.tracking.joint_iterations = 10;
  }

  // The message with which the request is refused; no file is left behind.
  std::string refusal() const {
    std::string message = "nothing was thrown";
    try {
      animate_from_video(request);
    } catch (const InputError& error) {
      message = error.what();
    }
    EXPECT_FALSE(fs::exists(request.out));
    return message;
  }

  bool refuses_with(const std::string& words) const { return refusal().find(words) != std::string::npos; }

  test::TemporaryFolder folder;
  fs::path rig = folder.path() / "bar.glb", frames = folder.path() / "frames";
  VideoAnimationRequest request;
};

TEST_F(VideoAnimation, WritesTheClipBesideASheet) {
  request.sheet = folder.path() / "sheet.png";
  const VideoAnimationReport report = animate_from_video(request);
  EXPECT_EQ(report.frames, 3u);
  EXPECT_EQ(report.clip, "frames");
  EXPECT_TRUE(report.copied);
  EXPECT_GT(report.overlap, 0.85);
  EXPECT_EQ(report.camera, "of transforms.json");
  EXPECT_GT(io::read_image(request.sheet).width, 300);
  const Asset moved = io::read_gltf(request.out).asset;
  ASSERT_EQ(moved.animations.size(), 1u);
  EXPECT_NEAR(moved.animations[0].duration(), 0.2, 1e-6);
  const Pose pose = sample(moved.animations[0], moved.skeleton, 0.2);
  const Pose bind = bind_pose(moved.skeleton);
  EXPECT_NEAR(pose[1].rotation.angularDistance(bind[1].rotation), 0.6, 0.12);
  EXPECT_NE(to_text(report).find("overlap"), std::string::npos);
  EXPECT_EQ(to_json(report).at("frames"), 3);
}

TEST_F(VideoAnimation, FitsACameraWhereThereIsNone) {
  fs::remove(frames / "transforms.json");
  const VideoAnimationReport report = animate_from_video(request);
  EXPECT_NE(report.camera.find("fitted"), std::string::npos);
  EXPECT_GT(report.overlap, 0.8);
}

TEST_F(VideoAnimation, RefusesBadFramesAndCameras) {
  request.video = folder.path() / "none";
  EXPECT_TRUE(refuses_with("no such folder or file"));
  request.video = frames;
  const std::string cameras = read_file(frames / "transforms.json");
  std::string damaged = cameras;
  damaged.replace(damaged.find("camera_angle_x") + 16, 4, " NaN");
  std::ofstream(frames / "transforms.json") << damaged;
  EXPECT_TRUE(refuses_with("transforms.json"));
  std::ofstream(frames / "transforms.json") << cameras;
  io::write_png(frames / "1.png", io::Image(64, 64, 0));
  EXPECT_TRUE(refuses_with("1.png"));
  io::write_png(frames / "1.png", io::Image(32, 64));
  EXPECT_TRUE(refuses_with("one size"));
  fs::remove(frames / "1.png");
  EXPECT_TRUE(refuses_with("1.png"));
  fs::create_directories(folder.path() / "empty");
  request.video = folder.path() / "empty";
  EXPECT_TRUE(refuses_with("empty"));
}

TEST_F(VideoAnimation, RefusesRigsAndResultsThatCannotBe) {
  request.out = folder.path() / "moved.stl";
  EXPECT_TRUE(refuses_with("an animated asset is a .glb"));
  request.out = rig;
  EXPECT_THROW(animate_from_video(request), InputError);
  request.out = folder.path() / "moved.glb";
  request.fps = 1e9;
  EXPECT_TRUE(refuses_with("--fps"));
  request.fps = 0.0;
  request.sheet = folder.path() / "sheet.jpg";
  EXPECT_TRUE(refuses_with("name a .png"));
  request.sheet.clear();
  Asset bare = test::two_bone_bar();
  bare.skin = {};
  bare.skeleton = {};
  bind_rigidly(bare, "only");
  bare.mesh.faces.clear();
  std::ofstream(folder.path() / "bare.glb") << "no glTF";
  request.asset = folder.path() / "bare.glb";
  EXPECT_TRUE(refuses_with("bare.glb"));
}

}  // namespace
}  // namespace anigen::generate
