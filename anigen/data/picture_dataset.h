#pragma once
#include <torch/torch.h>
#include <memory>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/data/datasets.h"
#include "anigen/render/cameras_json.h"

namespace anigen::data {

/// Truth about a condition picture, at half its size; what the picture estimator (vision/picture_estimator.h) learns.
struct PictureTruth {
  std::vector<float> image;        ///< [3, S, S] in [0, 1], on black, as read_condition_image()
  std::vector<float> normals;      ///< [3, S/2, S/2] unit vectors in the camera's frame: x right, y up, z to the viewer
  std::vector<float> coordinates;  ///< [3, S/2, S/2] place on the surface, object's frame, in [-0.5, 0.5]³
  std::vector<float> mask;         ///< [S/2, S/2] 1 where both are known, else 0
  render::PartCamera camera;       ///< of the cropped picture
};

/// A random condition view with its truth. @param folder renders_cond/<id> @param size S, even
/// @throws InputError naming the file: what read_condition_image() says; no normals or depths beside the picture
PictureTruth read_picture_truth(const std::filesystem::path& folder, int size, Rng& rng);

/// `dataset.args` of AniGenPictures, ours: condition pictures with the truth about them. Rows need `cond_rendered`, and
/// views made with --view-geometry.
struct PictureOptions {
  SourceOptions sources;
  int image_size = 128;               ///< edge of the picture, even
  double light = 0.0;                 ///< spread of the brightness and the tint of a picture, as natural logarithms
  std::vector<std::string> families;  ///< values of column source that are told apart; others are of no family

  static PictureOptions read(ConfigReader& reader);
};

struct PictureBatch : Batch {
  torch::Tensor image;                      ///< [B, 3, S, S] fp32 in [0, 1]
  torch::Tensor normals, coordinates;       ///< [B, 3, S/2, S/2]
  torch::Tensor mask;                       ///< [B, S/2, S/2]
  torch::Tensor family;                     ///< [B] int64, index in PictureOptions::families, -1: none of them
  std::vector<render::PartCamera> cameras;  ///< [B]
};

/// AniGenPictures: one random condition view of an asset.
class PictureDataset : public AssetDataset {
 public:
  PictureDataset(std::vector<AssetId> assets, const PictureOptions& options, std::uint64_t seed);

  const PictureOptions& options() const { return options_; }

 private:
  struct Picture;
  std::unique_ptr<Sample> read(std::size_t asset, std::uint64_t position) const override;
  std::unique_ptr<Batch> collate(const Samples& samples, const std::vector<std::string>& ids) const override;

  PictureOptions options_;
};

}  // namespace anigen::data
