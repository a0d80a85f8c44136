#pragma once
#include <torch/torch.h>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/data/datasets.h"
#include "anigen/io/image.h"

namespace anigen::data {

/// Object in the frame of a picture of S × S pixels.
struct PlacedObject {
  std::vector<float> color;  ///< [3, S, S] in [0, alpha]: multiplied by alpha
  std::vector<float> alpha;  ///< [S, S] in [0, 1]
};

/// Brings an object into a frame. @param cutout with alpha @param scale longer side of the cut-out in sides of the
/// frame
/// @param x, y centre of the cut-out in the frame, in its sides from the upper left corner @param mirrored left to
/// right
PlacedObject place_object(const io::Image& cutout, int size, double scale, double x, double y, bool mirrored);

/// The object before a background: color + (1 − alpha) · background. @param background [3, S, S] @return [3, S, S]
std::vector<float> before_background(const PlacedObject& object, const std::vector<float>& background);

/// `dataset.args` of AniGenMattings, ours: objects composed over backgrounds. Rows need `cond_rendered`. Chances and
/// spreads of 0 switch a change off.
struct MattingOptions {
  SourceOptions sources;
  int image_size = 128;               ///< edge of the picture
  std::filesystem::path pictures;     ///< folder of cut-out pictures, objects beside the views; empty: none
  double picture_share = 0.25;        ///< of the samples, whose object is one of them; none in evaluations
  std::filesystem::path backgrounds;  ///< folder of real pictures to crop backgrounds from; empty: all are drawn
  double background_share = 0.5;      ///< of the samples, before one of them
  double jitter = 0.15;               ///< spread of brightness, contrast and tint of object and background
  double shadow = 0.4;                ///< chance of a soft shadow below the object
  double blur = 0.3, noise = 0.3, jpeg = 0.3;  ///< chances of blurred, noisy and compressed pictures

  /// Contents of the two folders, read once for training and evaluation.
  std::shared_ptr<const std::vector<io::Image>> cutouts, scenes;

  /// Reads the pictures, too; a folder is relative to the first root of the dataset where it has it.
  /// @throws InputError as read_pictures(); a share without its folder
  static MattingOptions read(ConfigReader& reader);
};

struct MattingBatch : Batch {
  torch::Tensor image;  ///< [B, 3, S, S] fp32 in [0, 1]
  torch::Tensor alpha;  ///< [B, 1, S, S] fp32 in [0, 1]
};

/// AniGenMattings: one random condition view of an asset, or a cut-out picture, at a random place and scale before a
/// random background; what the matting network (vision/matting.h) learns.
class MattingDataset : public AssetDataset {
 public:
  MattingDataset(std::vector<AssetId> assets, const MattingOptions& options, std::uint64_t seed);

  const MattingOptions& options() const { return options_; }

 private:
  struct Composed;
  std::unique_ptr<Sample> read(std::size_t asset, std::uint64_t position) const override;
  std::unique_ptr<Batch> collate(const Samples& samples, const std::vector<std::string>& ids) const override;

  MattingOptions options_;
};

}  // namespace anigen::data
