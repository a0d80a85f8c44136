#include "anigen/generate/retrieve.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/render/cameras_json.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::generate {
namespace {

namespace fs = std::filesystem;
using Rgb = std::array<std::uint8_t, 3>;

/// A disc of one colour on transparent ground, left of the middle.
io::Image disc(const Rgb& color, int radius = 20) {
  io::Image image;
  image.width = image.height = 96;
  image.rgba.assign(4U * 96 * 96, 0);
  for (int y = 0; y < 96; ++y) {
    for (int x = 0; x < 96; ++x) {
      if ((x - 40) * (x - 40) + (y - 48) * (y - 48) > radius * radius) continue;
      std::uint8_t* pixel = image.rgba.data() + 4 * (y * 96 + x);
      for (int c = 0; c < 3; ++c) pixel[c] = color[static_cast<std::size_t>(c)];
      pixel[3] = 255;
    }
  }
  return image;
}

class RetrieveAssets : public testing::Test {
 protected:
  RetrieveAssets() {
    add("red", {220, 30, 30});
    add("green", {30, 200, 40});
    add("blind", {0, 0, 0}, /*views=*/0);
    write_file_atomically(data() / "metadata.csv",
                          "sha256,local_path\nred,red.glb\ngreen,green.glb\nblind,blind.glb\n");
    request_.dataset = data();
    request_.output = folder_ / "out";
  }
  fs::path data() const { return folder_ / "data"; }

  void add(const std::string& id, const Rgb& color, int views = 2) {
    fs::create_directories(data() / "skeleton" / id);
    test::write_rig_npz(data() / "skeleton" / id / "skeleton_voxelized.npz", rig_);
    if (views == 0) return;
    render::Transforms transforms;
    for (int i = 0; i < views; ++i) {
      const std::string name = "00" + std::to_string(i) + ".png";
      io::write_png(data() / "renders_cond" / id / name, disc(color, 20 + 5 * i));
      render::Frame frame;
      frame.file_path = name;
      frame.camera_angle_x = 0.7;
      transforms.frames.push_back(frame);
    }
    render::write_transforms(data() / "renders_cond" / id / "transforms.json", transforms);
  }
  fs::path picture(const std::string& name, const Rgb& color) {
    io::write_png(folder_ / (name + ".png"), disc(color, 14));
    return folder_ / (name + ".png");
  }

  test::TemporaryFolder folder_;
  const test::RigFile rig_;
  RetrievalRequest request_;
};

TEST_F(RetrieveAssets, AnswersWithTheMostSimilarViewsAsset) {
  const auto reports = retrieve_assets(request_, {picture("leaf", {40, 190, 30}), picture("rose", {200, 20, 40})});
  ASSERT_EQ(reports.size(), 2u);
  EXPECT_EQ(reports[0].asset, "green");
  EXPECT_EQ(reports[1].asset, "red");
  EXPECT_LT(reports[0].distance, 0.1);
  const Asset asset = io::read_gltf(folder_ / "out/leaf/mesh.glb").asset;
  EXPECT_EQ(asset.skeleton.size(), static_cast<std::size_t>(rig_.joint_count()));
  EXPECT_EQ(read_json(folder_ / "out/leaf/generation.json")["retrieved"], "green");
}

TEST_F(RetrieveAssets, GivesTheDataSetsOwnFileWhereThereIsOne) {
  test::write_glb(data() / "assets/red.glb", rig_);
  retrieve_assets(request_, {picture("rose", {200, 20, 40})});
  EXPECT_EQ(read_file(folder_ / "out/rose/mesh.glb"), read_file(data() / "assets/red.glb"));
}

TEST_F(RetrieveAssets, AResultThatWouldReplaceAnInputIsRefused) {
  test::write_glb(data() / "assets/red.glb", rig_);
  const std::string before = read_file(data() / "assets/red.glb");
  fs::create_directories(folder_ / "out/rose");
  fs::create_hard_link(data() / "assets/red.glb", folder_ / "out/rose/mesh.glb");
  const fs::path rose = picture("rose", {200, 20, 40});
  EXPECT_THROW(retrieve_assets(request_, {rose}), InputError);
  EXPECT_FALSE(fs::exists(folder_ / "out/rose/generation.json"));
  fs::remove(folder_ / "out/rose/mesh.glb");
  fs::create_symlink(rose, folder_ / "out/rose/generation.json");
  EXPECT_THROW(retrieve_assets(request_, {rose}), InputError);
  EXPECT_EQ(read_file(data() / "assets/red.glb"), before);
  fs::remove(folder_ / "out/rose/generation.json");
  EXPECT_EQ(retrieve_assets(request_, {rose}).at(0).failure, "");
  EXPECT_EQ(retrieve_assets(request_, {rose}).at(0).failure, "") << "its own results may be made again";
}

TEST_F(RetrieveAssets, ASplitChoosesWhatMayBeAnswered) {
  write_file_atomically(folder_ / "split.txt", "red\n");
  request_.splits = {folder_ / "split.txt"};
  EXPECT_EQ(retrieve_assets(request_, {picture("leaf", {40, 190, 30})})[0].asset, "red");
  write_file_atomically(folder_ / "split.txt", "blind\n");
  EXPECT_THROW(retrieve_assets(request_, {picture("leaf", {40, 190, 30})}), InputError);
}

TEST_F(RetrieveAssets, LeavesOutWhatIsUnusable) {
  write_file_atomically(data() / "metadata.csv",
                        "sha256,local_path,is_bad_skeleton\nred,red.glb,False\ngreen,green.glb,True\n");
  EXPECT_EQ(retrieve_assets(request_, {picture("leaf", {40, 190, 30})})[0].asset, "red");
  write_file_atomically(data() / "metadata.csv", "sha256,local_path\nred,red.glb\ngreen,green.glb\n");
  write_file_atomically(data() / "renders_cond/red/001.png", "damaged");
  EXPECT_EQ(retrieve_assets(request_, {picture("rose", {200, 20, 40})})[0].asset, "green");
}

TEST_F(RetrieveAssets, SeveralViewsOfAnAssetAreSpreadOverThoseThereAre) {
  add("orange", {220, 120, 30}, /*views=*/8);
  write_file_atomically(data() / "metadata.csv", "sha256,local_path\norange,orange.glb\nred,red.glb\n");
  write_file_atomically(folder_ / "split.txt", "orange\n");
  const NamedPicture views = pictures_of_dataset(data(), {folder_ / "split.txt"}, 0, 4).at(0);
  EXPECT_EQ(views.file.filename(), "000.png");
  ASSERT_EQ(views.others.size(), 3u);
  const char* spread[] = {"002.png", "004.png", "006.png"};
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(views.others[i].file.filename(), spread[i]);
  write_file_atomically(folder_ / "split.txt", "red\n");
  EXPECT_THROW(pictures_of_dataset(data(), {folder_ / "split.txt"}, 0, 4), InputError) << "two views";
}

TEST_F(RetrieveAssets, PicturesOfADatasetAreItsFirstViewsCalledAsTheAssets) {
  write_file_atomically(folder_ / "split.txt", "green\nred\ngreen\n");
  const auto pictures = pictures_of_dataset(data(), {folder_ / "split.txt"}, 0);
  ASSERT_EQ(pictures.size(), 2u);
  EXPECT_EQ(pictures[0].name, "green");
  EXPECT_EQ(pictures[0].file, data() / "renders_cond/green/000.png");
  const auto reports = retrieve_assets(request_, pictures);
  EXPECT_EQ(reports[0].asset, "green");
  EXPECT_TRUE(fs::exists(folder_ / "out/red/mesh.glb"));
  EXPECT_EQ(pictures_of_dataset(data(), {folder_ / "split.txt"}, 1).size(), 1u);
  write_file_atomically(folder_ / "split.txt", "raw/green.glb\n");
  EXPECT_EQ(pictures_of_dataset(data(), {folder_ / "split.txt"}, 0).at(0).name, "green") << "by another name";
  EXPECT_THROW(pictures_of_dataset(data(), {}, 0), InputError);
  for (const char* unusable : {"blind\n", "nobody\n", "../red\n"}) {
    write_file_atomically(folder_ / "split.txt", unusable);
    EXPECT_THROW(pictures_of_dataset(data(), {folder_ / "split.txt"}, 0), InputError) << unusable;
  }
}

TEST_F(RetrieveAssets, ComparesNormalsWhereTheyAreAskedFor) {
  request_.seen = data::ConditionPictures::kNormals;
  EXPECT_THROW(retrieve_assets(request_, {}), InputError) << "no view has a map of normals";

  // Colours say red and normals say green; the pictures asked about are the dataset's own.
  const auto add_maps = [this](const char* id, const Rgb& first, const Rgb& second) {
    io::write_png(data() / "renders_cond" / id / "000_normal.png", disc(first));
    io::write_png(data() / "renders_cond" / id / "001_normal.png", disc(second, 25));
  };
  add_maps("red", {250, 127, 127}, {250, 127, 127});
  add_maps("green", {127, 127, 250}, {127, 127, 250});
  write_file_atomically(folder_ / "split.txt", "red\n");
  auto pictures = pictures_of_dataset(data(), {folder_ / "split.txt"}, 0);
  EXPECT_EQ(pictures.front().normal_map, data() / "renders_cond/red/000_normal.png");
  EXPECT_EQ(retrieve_assets(request_, pictures)[0].asset, "red");
  pictures.front().normal_map = data() / "renders_cond/green/000_normal.png";
  const auto reports = retrieve_assets(request_, pictures);
  EXPECT_EQ(reports[0].asset, "green");
  EXPECT_LT(reports[0].distance, 0.01);
  EXPECT_NE(retrieve_assets(request_, {picture("rose", {200, 20, 40})})[0].failure, "") << "a picture without a map";
}

TEST_F(RetrieveAssets, ABrokenPictureIsReported) {
  write_file_atomically(folder_ / "text.png", "not a picture");
  const auto reports = retrieve_assets(request_, {folder_ / "text.png", picture("leaf", {40, 190, 30})});
  EXPECT_NE(reports[0].failure, "");
  EXPECT_EQ(reports[1].failure, "");
  EXPECT_FALSE(fs::exists(folder_ / "out/text"));
  EXPECT_THROW(retrieve_assets(request_, {folder_ / "a/leaf.png", folder_ / "b/leaf.png"}), InputError);
}

}  // namespace
}  // namespace anigen::generate
