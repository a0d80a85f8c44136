#include "anigen/io/rigs/bvh.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "tests/io/file_fuzz.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::io {
namespace {

constexpr char kFile[] =
    "HIERARCHY\n"                                                                 // 1
    "ROOT Hips\n"                                                                 // 2
    "{\n"                                                                         // 3
    "  OFFSET 0 1 0\n"                                                            // 4
    "  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n"  // 5
    "  JOINT Arm\n"                                                               // 6
    "  {\n"                                                                       // 7
    "    OFFSET 2 0 0\n"                                                          // 8
    "    CHANNELS 3 Yrotation Xrotation Zrotation\n"                              // 9
    "    End Site\n"                                                              // 10
    "    {\n"                                                                     // 11
    "      OFFSET 1 0 0\n"                                                        // 12
    "    }\n"                                                                     // 13
    "  }\n"                                                                       // 14
    "}\n"                                                                         // 15
    "MOTION\n"                                                                    // 16
    "Frames: 2\n"                                                                 // 17
    "Frame Time: 0.5\n"                                                           // 18
    "0 1 0 0 0 0 0 0 0\n"                                                         // 19
    "1 2 3 90 0 0 90 90 0\n";                                                     // 20

std::string changed(const std::string& from, const std::string& to) {
  std::string text = kFile;
  const std::size_t place = text.find(from);
  EXPECT_NE(place, std::string::npos) << from;
  return text.replace(place, from.size(), to);
}

std::string refusal_of(const std::string& text) {
  return test::refusal([&] { parse_bvh(text, "walk.bvh"); });
}

void expect_near(const Eigen::Matrix4d& matrix, const Eigen::Vector3d& place) {
  EXPECT_LT((matrix.topRightCorner<3, 1>() - place).norm(), 1e-12) << matrix;
}

TEST(Bvh, ReadsTheSkeletonZUp) {
  const BvhMotion motion = parse_bvh(kFile, "captures/walk.bvh");
  EXPECT_EQ(motion.skeleton.names, (std::vector<std::string>{"Hips", "Arm", "Arm_end"}));
  EXPECT_EQ(motion.skeleton.parents, (std::vector<int>{-1, 0, 1}));
  expect_near(motion.skeleton.bind[0], {0, 0, 1});
  expect_near(motion.skeleton.bind[2], {3, 0, 1});
  EXPECT_EQ(motion.frames, 2u);
  EXPECT_EQ(motion.frame_time, 0.5);
  EXPECT_EQ(motion.animation.name, "walk");
  EXPECT_EQ(motion.animation.duration(), 0.5);
}

TEST(Bvh, TurnsInTheOrderOfTheChannels) {
  const BvhMotion motion = parse_bvh(kFile, "walk.bvh");
  const auto world = [&](double time) {
    return forward_kinematics(motion.skeleton.parents, sample(motion.animation, motion.skeleton, time));
  };
  for (std::size_t j = 0; j < 3; ++j) EXPECT_LT((world(0.0)[j] - motion.skeleton.bind[j]).norm(), 1e-12);
  // In the file's axes: the root moves to (1, 2, 3) and turns X into Y, so the arm is at (1, 4, 3). The arm turns by X
  // first and by Y last, which takes its X to -Z.
  const std::vector<Eigen::Matrix4d> moved = world(0.5);
  expect_near(moved[0], {1, -3, 2});
  expect_near(moved[1], {1, -3, 4});
  expect_near(moved[2], {1, -2, 4});
}

TEST(Bvh, TakesAnyCaseBlanksAndLineEnds) {
  std::string text = changed("CHANNELS 3 Yrotation", "channels 3\n YROTATION");
  for (std::size_t at = 0; (at = text.find('\n', at)) != std::string::npos; at += 3) text.replace(at, 1, " \r\n");
  text += "\n\n";
  EXPECT_EQ(parse_bvh(text, "walk.bvh").skeleton.size(), 3u);
  // Without position channels the offset stands.
  const BvhMotion still = parse_bvh(
      "HIERARCHY ROOT a { OFFSET 0 0 4 CHANNELS 1 Zrotation } MOTION Frames: 1 Frame Time: 1\n30\n", "still.bvh");
  EXPECT_EQ(still.animation.channels.size(), 1u);
  expect_near(forward_kinematics(still.skeleton.parents, sample(still.animation, still.skeleton, 0))[0], {0, -4, 0});
}

TEST(Bvh, NamesLineAndProblem) {
  const struct {
    std::string text, expected;
  } cases[] = {
      {"", "line 1: the file ends"},
      {"HIERARCHIE\n", "line 1: \"HIERARCHIE\" where \"hierarchy\""},
      {changed("JOINT Arm", "JOINT Hips"), "line 8: there is a joint \"Hips\" already"},
      {changed("OFFSET 2 0 0", "OFFSET 2 0"), "line 9: \"CHANNELS\" is not a number"},
      {changed("OFFSET 2 0 0", "OFFSET 2 nan 0"), "line 8: \"nan\" is not finite"},
      {changed("OFFSET 2 0 0", "OFFSET 2 1e12 0"), "line 8: \"1e12\" is too large"},
      {changed("3 Yrotation", "3 Wrotation"), "line 9: \"Wrotation\" is not a channel"},
      {changed("Yrotation Xrotation Zrotation", "Yrotation Xrotation Yrotation"),
       "line 9: the channel Yrotation is given"},
      {changed("CHANNELS 3", "CHANNELS 7"), "line 9: the number of channels"},
      {changed("CHANNELS 3", "CHANNELS 2"), "line 9: \"Zrotation\" is none of"},
      {changed("    End Site", "    CHANNELS 0\n"), "line 10: a second CHANNELS of Arm"},
      {changed("    End Site", "    Leaf"), "line 10: \"Leaf\" is none of"},
      {changed("Frames: 2", "Frames: 0"), "line 17: there is no frame"},
      {changed("Frames: 2", "Frames: -2"), "line 17: the number of frames"},
      {changed("Frames: 2", "Frames: 900000000"), "more than this program takes"},
      {changed("Frames: 2", "Frames: 3"), "the file ends after 2 of 3 frames"},
      {changed("0.5", "0"), "line 18: the time of a frame must be positive"},
      {changed("0 1 0 0 0 0 0 0 0", "0 1 0 0 0 0 0 0"), "line 19: the frame has 8 values for 9 channels"},
      {changed("0 1 0 0 0 0 0 0 0", "0 1 0 0 0 0 0 0 0 7"), "line 19: the frame has 10 values for 9 channels"},
      {changed("1 2 3 90", "1 2 inf 90"), "line 20: \"inf\" is not finite"},
      {changed("1 2 3 90", "1 2 x 90"), "line 20: \"x\" is not a number"},
  };
  for (const auto& [text, expected] : cases)
    EXPECT_NE(refusal_of(text).find(expected), std::string::npos) << expected << " <> " << refusal_of(text);
  EXPECT_NE(refusal_of(changed("MOTION", "ROOT Other { OFFSET 0 0 0 }\nMOTION")).find("not supported"),
            std::string::npos);
}

// As Boxing_Toes.bvh of assimp's test models, which has one frame more than it says.
TEST(Bvh, FramesBeyondTheAnnouncedAreLeftOut) {
  const BvhMotion all = parse_bvh(kFile, "walk.bvh"), one = parse_bvh(changed("Frames: 2", "Frames: 1"), "walk.bvh");
  EXPECT_EQ(all.frames, 2U);
  EXPECT_EQ(one.frames, 1U);
}

TEST(Bvh, NestingIsNotRecursion) {
  std::string text = "HIERARCHY\nROOT j0 { OFFSET 0 0 0 CHANNELS 1 Xrotation\n";
  for (int j = 1; j < 20000; ++j) text += "JOINT j" + std::to_string(j) + " { OFFSET 0 1 0\n";
  EXPECT_NE(refusal_of(text).find("more than 10000 joints"), std::string::npos);
}

TEST(Bvh, DamagedFilesAreErrors) {
  const test::TemporaryFolder folder;
  test::expect_errors_only(kFile, folder / "damaged.bvh", [](const std::filesystem::path& file) { read_bvh(file); });
  EXPECT_THROW(read_bvh(folder / "missing.bvh"), InputError);
}

}  // namespace
}  // namespace anigen::io
