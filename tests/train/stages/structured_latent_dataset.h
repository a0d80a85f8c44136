#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/image.h"
#include "tests/train/stages/published_sample.h"

namespace anigen::test {

/// Models for PostDataset, the smallest there are: up-sampling needs 256 channels for its 32 groups.
inline Json post_models() {
  return Json::parse(R"({
    "encoder": {"name": "AniGenElasticSLatEncoder", "args": {
      "resolution": 64, "in_channels": 4, "model_channels": 24, "model_channels_skl": 16, "model_channels_skin": 16,
      "latent_channels": 8, "latent_channels_skl": 4, "latent_channels_vertskin": 8, "num_blocks": 1, "num_heads": 4,
      "num_heads_skl": 4, "num_heads_skin": 4, "mlp_ratio": 1, "attn_mode_cross": "swin",
      "skin_encoder_config": {"skin_feat_channels": 4, "jp_embed_dim": 16,
                              "jp_embedder_config": {"hidden_dim": 16, "depth": 1}},
      "skin_cross_from_geo": false, "skl_cross_from_geo": false, "skin_skl_cross": false,
      "use_pretrain_branch": false, "jp_residual_fields": true, "jp_hyper_continuous": true}},
    "decoder": {"name": "AniGenElasticSLatMeshDecoder", "args": {
      "resolution": 64, "model_channels": 256, "model_channels_skl": 32, "model_channels_skin": 32,
      "latent_channels": 8, "latent_channels_skl": 4, "latent_channels_vertskin": 8, "num_blocks": 1, "num_heads": 4,
      "num_heads_skl": 4, "num_heads_skin": 4, "mlp_ratio": 0.25, "attn_mode_cross": "swin",
      "h_skin_unet_num_levels": -1,
      "skin_decoder_config": {"skin_feat_channels": 4, "model_channels": 16, "num_blocks": 1},
      "representation_config": {"use_color": true, "use_conf_jp": true, "use_conf_skin": false},
      "use_pretrain_branch": false, "jp_residual_fields": true, "jp_hyper_continuous": true}}})");
}

/// A dataset of rigged boxes in the published layout: post0, post1, … stand upright in the middle of the 64³ grid, 4 ×
/// 4 voxels wide and 6 to 8 high, with three joints on their axis and weights that pass from each to the next. Four
/// channels of features "toy"; two views that the box fills. splits/test.txt holds the last one.
class PostDataset {
 public:
  static constexpr int kChannels = 4, kJoints = 3, kLow = 30, kHigh = 33;

  static std::string id(int i) { return "post" + std::to_string(i); }

  static void write(const std::filesystem::path& root, int count) {
    std::filesystem::create_directories(root / "voxels");
    std::filesystem::create_directories(root / "splits");
    std::ofstream csv(root / "metadata.csv"), split(root / "splits" / "test.txt");
    csv << "sha256,aesthetic_score,num_voxels,feature_toy,is_bad_skin,is_bad_skeleton,is_test\n";
    for (int i = 0; i < count; ++i) {
      csv << id(i) << ",6.5," << surface(i).size() << ",True,False,False,False\n";
      write_asset(root, i);
    }
    split << id(count - 1) << "\n";
  }

 private:
  using Index = std::array<double, 3>;

  // Lowest and highest voxel of the box upwards.
  static int bottom(int i) { return 29 - i % 2; }
  static int top(int i) { return 34 + i % 2; }

  static std::vector<Index> surface(int i) {
    std::vector<Index> voxels;
    for (int x = kLow; x <= kHigh; ++x) {
      for (int y = kLow; y <= kHigh; ++y) {
        for (int z = bottom(i); z <= top(i); ++z) {
          const bool outside = x == kLow || x == kHigh || y == kLow || y == kHigh || z == bottom(i) || z == top(i);
          if (outside) voxels.push_back({double(x), double(y), double(z)});
        }
      }
    }
    return voxels;
  }

  static void write_asset(const std::filesystem::path& root, int i) {
    const std::vector<Index> voxels = surface(i);
    PublishedSample::write_centres(root / "voxels" / (id(i) + ".ply"), voxels);
    std::vector<Index> axis;
    for (int z = bottom(i); z <= top(i); ++z) axis.push_back({32, 32, double(z)});
    PublishedSample::write_centres(root / "voxels" / (id(i) + "_skeleton.ply"), axis);

    std::vector<std::uint8_t> indices;
    std::vector<float> tokens;
    for (const Index& voxel : voxels) {
      for (const double k : voxel) {
        indices.push_back(static_cast<std::uint8_t>(k));
        tokens.push_back(static_cast<float>((k - 31.5) / 4.0));
      }
      tokens.push_back(1.0F);
    }
    const auto rows = static_cast<std::int64_t>(voxels.size());
    io::write_npz(root / "features" / "toy" / (id(i) + ".npz"),
                  {{"indices", io::NdArray::from(indices, {rows, 3})},
                   {"patchtokens", PublishedSample::halves(tokens, {rows, kChannels})}});
    io::write_npz(root / "skeleton" / id(i) / "skeleton_voxelized.npz", rig(i));
    write_views(root / "renders" / id(i));
  }

  static float place(int boundary) { return static_cast<float>(boundary) / 64.0F - 0.5F; }

  static io::NamedArrays rig(int i) {
    const float low = place(kLow), high = place(kHigh + 1), floor = place(bottom(i)), roof = place(top(i) + 1);
    const float middle = 0.5F * (floor + roof);
    // Corners at three heights, so that every joint has its ring.
    const std::array<std::array<float, 2>, 4> corners{{{low, low}, {high, low}, {high, high}, {low, high}}};
    std::vector<float> vertices, skin;
    for (int ring = 0; ring < kJoints; ++ring) {
      const float height = ring == 0 ? floor : ring == 1 ? middle : roof;
      for (const std::array<float, 2>& corner : corners) {
        vertices.insert(vertices.end(), {corner[0], corner[1], height});
        for (int joint = 0; joint < kJoints; ++joint) skin.push_back(joint == ring ? 1.0F : 0.0F);
      }
    }
    std::vector<std::int64_t> faces{0, 2, 1, 0, 3, 2, 8, 9, 10, 8, 10, 11};  // floor and roof
    for (std::int64_t ring = 0; ring < 2; ++ring) {
      for (std::int64_t side = 0; side < 4; ++side) {
        const std::int64_t a = 4 * ring + side, b = 4 * ring + (side + 1) % 4;
        faces.insert(faces.end(), {a, b, b + 4, a, b + 4, a + 4});
      }
    }
    return {{"joints", io::NdArray::from(std::vector<float>{0, 0, floor, 0, 0, middle, 0, 0, roof}, {kJoints, 3})},
            {"parents", io::NdArray::from(std::vector<std::int64_t>{-1, 0, 1}, {kJoints})},
            {"skin", io::NdArray::from(skin, {4 * kJoints, kJoints})},
            {"vertices", io::NdArray::from(vertices, {4 * kJoints, 3})},
            {"faces", io::NdArray::from(faces, {static_cast<std::int64_t>(faces.size() / 3), 3})}};
  }

  static void write_views(const std::filesystem::path& folder) {
    std::filesystem::create_directories(folder);
    std::ofstream(folder / "transforms.json")
        << R"({"aabb": [[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]], "scale": 1.0, "offset": [0, 0, 0], "frames": [
  {"file_path": "000.png", "camera_angle_x": 0.1,
   "transform_matrix": [[1, 0, 0, 0], [0, 0, -1, -2], [0, 1, 0, 0], [0, 0, 0, 1]]},
  {"file_path": "001.png", "camera_angle_x": 0.1,
   "transform_matrix": [[0, 0, 1, 2], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]}]})";
    io::write_png(folder / "000.png", PublishedSample::picture(200, 100, 50));
    io::write_png(folder / "001.png", PublishedSample::picture(20, 140, 60));
  }
};

}  // namespace anigen::test
