#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/features/image_condition.h"
#include "anigen/features/normal_estimator.h"
#include "anigen/pipeline/preprocessing/foreground.h"
#include "anigen/pipeline/preprocessing/input_picture.h"
#include "anigen/pipeline/preprocessing/matting_network.h"
#include "anigen/pipeline/preprocessing/normal_source.h"

namespace anigen::pipeline {

struct PreprocessingOptions {
  int size = features::kConditionSize;  ///< of the results, S
  Background background = Background::kAuto;
  MattingOptions matting;
  NormalSource normals = NormalSource::kAuto;
  int estimator_side = 0;  ///< longest side that the estimator sees; 0: the whole picture, as published
};

/// What a picture becomes before the flow models are conditioned on it.
struct PreprocessedImage {
  io::Image picture;                             ///< S × S, opaque, the object on black
  io::Image normals;                             ///< its surface normals, cut out, cropped and resized alike
  torch::Tensor picture_tensor, normals_tensor;  ///< the same, [1, 3, S, S] fp32 in [0, 1]
  std::vector<std::string> notices;              ///< what was done, a sentence each: turning, background, normals
};

/// Pictures as people take them → what the flow models see (reference flows-and-pipeline.md, 5.2).
///
/// A picture with transparency is used as it is; of another one the background is removed, after it has been reduced to
/// 1024 pixels. Both pictures are cropped to io::inference_box, resized and put on black. Unlike the published pipeline
/// it turns pictures upright by EXIF, and counts the alpha of grey and palette pictures, not of RGBA alone.
class ImagePreprocessor {
 public:
  /// Loads the matting network, when there is one.
  /// @param estimator for NormalSource::kEstimator
  /// @throws InputError when an option lacks what it needs, or the network is unusable
  explicit ImagePreprocessor(const PreprocessingOptions& options,
                             std::shared_ptr<features::NormalEstimator> estimator = nullptr);

  /// @param normal_map for NormalSource::kFile and kAuto, which alone read it
  /// @throws InputError for an unusable picture or normal map, or when no object is found in it
  PreprocessedImage run(const std::filesystem::path& picture, const std::filesystem::path& normal_map = {});
  /// @param normal_map nullptr: none; NormalSource::kFile needs one
  PreprocessedImage run(const InputPicture& picture, const InputPicture* normal_map = nullptr);

 private:
  /// Removes the background, or keeps it, and says so. Transparent black outside the object.
  io::Image object_of(const InputPicture& picture, std::vector<std::string>& notices);
  /// A picture of normals as large as `object`; nothing for NormalSource::kColors.
  std::optional<io::Image> normals_of(const InputPicture& picture, const InputPicture* normal_map,
                                      const io::Image& object, std::vector<std::string>& notices);

  PreprocessingOptions options_;
  std::shared_ptr<features::NormalEstimator> estimator_;
  std::unique_ptr<MattingNetwork> network_;
};

}  // namespace anigen::pipeline
