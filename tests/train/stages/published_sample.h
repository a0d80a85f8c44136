#pragma once
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "anigen/io/arrays/ndarray.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/image.h"
#include "tests/support/paths.h"

namespace anigen::test {

/// A dataset in the published layout, written here from its specification (docs/reference/training.md, 1.1) and by none
/// of the code that prepares datasets: three assets "asset0" … "asset2" with 4, 5 and 6 surface voxels, 2 skeleton
/// voxels, 2 joints, 3 vertices; features of 3 channels, latents of 16 and 4, dense latents of 8 and 4 with edge 2.
class PublishedSample {
 public:
  static constexpr int kAssets = 3, kChannels = 3;

  /// A copy of the sample below `root`; the files are made once, since every one that is written is synced to disk.
  explicit PublishedSample(std::filesystem::path root) : root_(std::move(root)) {
    static const TemporaryFolder made;
    static const bool written = PublishedSample().write(made.path());
    if (written) std::filesystem::copy(made.path(), root_, std::filesystem::copy_options::recursive);
  }

  static std::string id(int i) { return "asset" + std::to_string(i); }
  const std::filesystem::path& root() const { return root_; }
  std::filesystem::path surface(int i) const { return root_ / "voxels" / (id(i) + ".ply"); }
  std::filesystem::path skeleton_voxels(int i) const { return root_ / "voxels" / (id(i) + "_skeleton.ply"); }
  std::filesystem::path features(int i) const { return root_ / "features" / "dino" / (id(i) + ".npz"); }
  std::filesystem::path view(int i) const { return root_ / "renders" / id(i); }
  std::filesystem::path condition(int i) const { return root_ / "renders_cond" / id(i); }
  std::filesystem::path rig(int i) const { return root_ / "skeleton" / id(i) / "skeleton_voxelized.npz"; }
  std::filesystem::path structure_latent(int i) const { return root_ / "ss_latents" / "ss" / (id(i) + ".npz"); }
  std::filesystem::path latent(int i) const { return root_ / "latents" / "slat" / (id(i) + ".npz"); }

  /// Surface voxel n of asset i.
  static std::array<std::uint8_t, 3> voxel(int i, int n) {
    return {static_cast<std::uint8_t>(10 + n), static_cast<std::uint8_t>(20 + i), static_cast<std::uint8_t>(63 - n)};
  }
  static float feature(int i, int n, int c) { return static_cast<float>(i) + 0.25f * static_cast<float>(n - c); }

  /// Binary PLY with the centres of voxels, little-endian floats.
  static void write_centres(const std::filesystem::path& path, const std::vector<std::array<double, 3>>& indices) {
    std::ofstream file(path, std::ios::binary);
    file << "ply\nformat binary_little_endian 1.0\nelement vertex " << indices.size()
         << "\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    for (const auto& index : indices) {
      for (const double k : index) {
        const auto centre = static_cast<float>((k + 0.5) / 64.0 - 0.5);
        file.write(reinterpret_cast<const char*>(&centre), 4);
      }
    }
  }

  /// Two cameras; frame 1 is turned by 90° about z.
  static void write_transforms(const std::filesystem::path& folder) {
    std::filesystem::create_directories(folder);
    std::ofstream(folder / "transforms.json")
        << R"({"aabb": [[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]], "scale": 1.0, "offset": [0, 0, 0], "frames": [
  {"file_path": "000.png", "camera_angle_x": 0.6981317007977318,
   "transform_matrix": [[1, 0, 0, 0], [0, 0, -1, -2], [0, 1, 0, 0], [0, 0, 0, 1]]},
  {"file_path": "001.png", "camera_angle_x": 0.6981317007977318,
   "transform_matrix": [[0, 0, 1, 2], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]}]})";
  }

  /// 16×16: transparent white, with an opaque rectangle [4, 8) × [6, 12) of that colour.
  static io::Image picture(std::uint8_t red, std::uint8_t green, std::uint8_t blue) {
    io::Image image(16, 16, 0);
    for (int y = 0; y < 16; ++y) {
      for (int x = 0; x < 16; ++x) {
        const bool object = x >= 4 && x < 8 && y >= 6 && y < 12;
        const std::array<std::uint8_t, 4> pixel =
            object ? std::array<std::uint8_t, 4>{red, green, blue, 255} : std::array<std::uint8_t, 4>{255, 255, 255, 0};
        std::memcpy(image.pixel(x, y), pixel.data(), 4);
      }
    }
    return image;
  }

  static io::NdArray halves(const std::vector<float>& values, std::vector<std::int64_t> shape) {
    io::NdArray array{io::Dtype::kF16, std::move(shape), {}};
    for (const float value : values) {
      const std::uint16_t half = io::float_to_half(value);
      array.bytes.push_back(static_cast<std::uint8_t>(half & 0xFF));
      array.bytes.push_back(static_cast<std::uint8_t>(half >> 8));
    }
    return array;
  }

  static io::NamedArrays feature_arrays(int i) {
    std::vector<std::uint8_t> indices;
    std::vector<float> tokens;
    for (int n = 0; n < 4 + i; ++n) {
      for (const std::uint8_t k : voxel(i, n)) indices.push_back(k);
      for (int c = 0; c < kChannels; ++c) tokens.push_back(feature(i, n, c));
    }
    return {{"indices", io::NdArray::from(indices, {4 + i, 3})}, {"patchtokens", halves(tokens, {4 + i, kChannels})}};
  }

  /// A triangle; row 1 has no weight, row 2 does not sum to 1.
  static io::NamedArrays rig_arrays() {
    return {{"joints", io::NdArray::from(std::vector<float>{0, 0, -0.25f, 0, 0, 0.25f}, {2, 3})},
            {"parents", io::NdArray::from(std::vector<std::int64_t>{-1, 0}, {2})},
            {"skin", io::NdArray::from(std::vector<float>{1, 0, 0, 0, 1, 3}, {3, 2})},
            {"vertices", io::NdArray::from(std::vector<float>{0, 0, -0.5f, 0.25f, 0, 0, 0, 0, 0.5f}, {3, 3})},
            {"faces", io::NdArray::from(std::vector<std::int32_t>{0, 1, 2}, {1, 3})}};
  }

  static io::NamedArrays latent_arrays(int i) {
    std::vector<std::uint8_t> coords, skeleton;
    std::vector<float> feats, feats_skl;
    for (int n = 0; n < 4 + i; ++n) {
      for (const std::uint8_t k : voxel(i, n)) coords.push_back(k);
      for (int c = 0; c < 16; ++c) feats.push_back(static_cast<float>(100 * i + n) + static_cast<float>(c) / 16.0f);
    }
    for (int n = 0; n < 2; ++n) {
      for (const int k : {30, 31, 32 + n}) skeleton.push_back(static_cast<std::uint8_t>(k));
      for (int c = 0; c < 4; ++c) feats_skl.push_back(c == n ? 1.0f : 0.0f);
    }
    return {{"coords", io::NdArray::from(coords, {4 + i, 3})},
            {"feats", io::NdArray::from(feats, {4 + i, 16})},
            {"coords_skl", io::NdArray::from(skeleton, {2, 3})},
            {"feats_skl", io::NdArray::from(feats_skl, {2, 4})}};
  }

  static io::NamedArrays structure_arrays(int i) {
    std::vector<float> mean, mean_skl;
    for (int k = 0; k < 64; ++k) mean.push_back(static_cast<float>(i) + static_cast<float>(k) / 64.0f);
    for (int k = 0; k < 32; ++k) mean_skl.push_back(static_cast<float>(-i) - static_cast<float>(k) / 64.0f);
    return {{"mean", io::NdArray::from(mean, {8, 2, 2, 2})}, {"mean_skl", io::NdArray::from(mean_skl, {4, 2, 2, 2})}};
  }

 private:
  PublishedSample() = default;

  bool write(const std::filesystem::path& root) {
    root_ = root;
    std::filesystem::create_directories(root_ / "voxels");
    std::ofstream csv(root_ / "metadata.csv");
    csv << "sha256,aesthetic_score,voxelized,num_voxels,feature_dino,cond_rendered,ss_latent_ss,latent_slat,"
           "is_bad_skin,is_bad_skeleton,is_test\n";
    for (int i = 0; i < kAssets; ++i) {
      csv << id(i) << ",6.5,True," << 4 + i << ",True,True,True,True,False,False,False\n";
      write_asset(i);
    }
    return true;
  }

  void write_asset(int i) {
    std::vector<std::array<double, 3>> voxels;
    for (int n = 0; n < 4 + i; ++n) {
      const auto v = voxel(i, n);
      voxels.push_back({static_cast<double>(v[0]), static_cast<double>(v[1]), static_cast<double>(v[2])});
    }
    write_centres(surface(i), voxels);
    write_centres(skeleton_voxels(i), {{32, 32, 33}, {0, 32, 33}, {32, 32, 33}});
    io::write_npz(features(i), feature_arrays(i));
    for (const auto& folder : {view(i), condition(i)}) {
      write_transforms(folder);
      io::write_png(folder / "000.png", picture(200, 100, 50));
      io::write_png(folder / "001.png", picture(20, 40, 60));
    }
    io::write_npz(rig(i), rig_arrays());
    io::write_npz(structure_latent(i), structure_arrays(i));
    io::write_npz(latent(i), latent_arrays(i));
  }

  std::filesystem::path root_;
};

}  // namespace anigen::test
