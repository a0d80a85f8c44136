#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/generate/matting_network.h"
#include "anigen/generate/preprocess.h"
#include "anigen/generate/trained_matting.h"
#include "anigen/io/image.h"
#include "anigen/vision/condition.h"
#include "anigen/vision/dsine.h"

namespace anigen::generate {

inline constexpr int kLeastPictureSide = 8;
/// Bounds the memory of preprocessing, whose largest part is the crop of a picture that fills its frame.
inline constexpr std::int64_t kMostPicturePixels = 100'000'000;

/// A picture that somebody hands in.
struct InputPicture {
  io::Image image;
  std::string name;     ///< for messages
  bool turned = false;  ///< by its EXIF orientation
};

/// A picture and what its asset is to be called.
struct NamedPicture {
  std::filesystem::path file;
  std::string name;
  std::filesystem::path
      normal_map;        ///< the surface normals seen in it, as normal_picture() colours them; empty: unknown
  std::string contents;  ///< the encoded image itself, where it is in memory; empty: that of the file
  /// Of the image's size once it is upright: the object is where it is above half (ImagePreprocessor). Empty: none.
  std::filesystem::path mask;
  std::string mask_contents;                    ///< as `contents`
  std::vector<NamedPicture> others;             ///< further images of the same object, whose names do not matter
  NamedPicture(std::filesystem::path picture);  ///< called as the file, without its ending
  NamedPicture(std::filesystem::path picture, std::string called);
};

/// A picture, or the pictures directly in a folder by name: png, jpg, jpeg, webp, bmp, tif, tiff.
/// @throws InputError when there is none
std::vector<NamedPicture> pictures_at(const std::filesystem::path& path);

/// Images of one object as views of one asset, called as the first of them.
/// @throws InputError without any, or with more than kMostViews
NamedPicture views_of_one(std::vector<NamedPicture> pictures);

/// Condition views of every asset that the splits name, called as the asset, with their true normals where the dataset
/// has them (anigen-prepare --view-geometry): the first one, or several, spread evenly over those there are.
/// @param most only so many of the first assets; 0: all @param views of each asset, at least 1
/// @throws InputError naming the asset that has no such view
std::vector<NamedPicture> pictures_of_dataset(const std::filesystem::path& dataset,
                                              const std::vector<std::filesystem::path>& splits, std::size_t most,
                                              std::size_t views = 1);

/// @throws InputError when two pictures have one name, whose assets would overwrite each other
void require_distinct_names(const std::vector<NamedPicture>& pictures);

/// Source of the image of surface normals that conditions the published first stage.
enum class NormalSource {
  kColors,     ///< nowhere: the colour picture stands in, which is what the published training configs show that stage
  kEstimator,  ///< a NormalEstimator sees the whole picture, as published
  kFile,       ///< a picture that the user supplies
  kAuto,       ///< kFile for a picture that comes with a map, kColors for the others
  kFlat        ///< a surface that faces the viewer everywhere, (128, 128, 255): the published pipeline without weights
};

inline const Words<NormalSource> kNormalSourceWords = {{NormalSource::kAuto, "auto"},
                                                       {NormalSource::kColors, "color"},
                                                       {NormalSource::kEstimator, "estimator"},
                                                       {NormalSource::kFile, "file"},
                                                       {NormalSource::kFlat, "flat"}};
/// @throws InputError for another word
NormalSource parse_normal_source(const std::string& word);

/// Normals as the colours that the published pipeline makes of them: x negated, (n + 1) / 2, rounded down to bytes
/// (docs/reference/flows.md, 5.2). This is the common colouring of the viewer's frame (X right, Y up, Z towards the
/// viewer): a wall that faces the camera is (127, 127, 255).
/// @param normals [1, 3, H, W] as NormalEstimator returns them @return opaque
/// @throws InputError when they are not finite
io::Image normal_picture(const torch::Tensor& normals);

/// A map that the user supplies, coloured as by normal_picture(), without alpha, resized (Lanczos) to its picture.
/// @throws InputError when its aspect differs from the picture's by more than a pixel or a hundredth
io::Image supplied_normals(const io::Image& map, int width, int height, const std::string& name);

io::Image flat_normals(int width, int height);

struct PreprocessingOptions {
  int size = vision::kConditionSize;  ///< of the results, S
  Background background = Background::kAuto;
  MattingOptions matting;
  NormalSource normals = NormalSource::kAuto;
  int estimator_side = 0;  ///< longest side that the estimator sees; 0: the whole picture, as published
};

/// Alpha of the object over the whole picture.
struct ObjectMask {
  int width = 0, height = 0;                  ///< at most 1024 where a background was removed
  int picture_width = 0, picture_height = 0;  ///< upright
  std::vector<std::uint8_t> alpha;            ///< [height · width]
};

/// Grey and opaque, as large as the picture: what NamedPicture::mask takes.
io::Image picture_of(const ObjectMask& mask);

/// Side of the largest crop that is kept for colours.
inline constexpr int kMostPartPixels = 1024;

/// Preprocessed image, before the flow models are conditioned on it.
struct PreprocessedImage {
  io::Image picture;                             ///< S × S, opaque, the object on black
  io::Image normals;                             ///< its surface normals, cut out, cropped and resized alike
  torch::Tensor picture_tensor, normals_tensor;  ///< the same, [1, 3, S, S] fp32 in [0, 1]
  io::Image part;                                ///< the object's crop with alpha, at most kMostPartPixels on a side
  ObjectMask mask;
  std::vector<std::string> notices;  ///< what was done, a sentence each: turning, background, normals
};

/// Pictures as people take them → what the flow models see (docs/reference/flows.md, 5.2).
///
/// A picture with transparency is used as it is; of another one the background is removed, after it has been reduced to
/// 1024 pixels. A mask that comes with a picture takes the place of both: the object is where its grey, times its own
/// alpha, is above half. Both pictures are cropped to io::inference_box, resized and put on black. Unlike the published
/// pipeline it turns pictures upright by EXIF, and counts the alpha of grey and palette pictures, not of RGBA alone.
class ImagePreprocessor {
 public:
  /// Loads the matting network, when there is one.
  /// @param estimator for NormalSource::kEstimator
  /// @throws InputError when an option lacks what it needs, or the network is unusable
  explicit ImagePreprocessor(const PreprocessingOptions& options,
                             std::shared_ptr<vision::NormalEstimator> estimator = nullptr);

  /// Its own view; its map is read for NormalSource::kFile and kAuto alone.
  /// @throws InputError for an unusable picture, mask or normal map, a mask of another size than its picture's, or when
  /// no object is found in it
  PreprocessedImage run(const NamedPicture& picture);
  /// @param normal_map nullptr: none; NormalSource::kFile needs one @param mask nullptr: none
  PreprocessedImage run(const InputPicture& picture, const InputPicture* normal_map = nullptr,
                        const InputPicture* mask = nullptr);
  /// The whole picture without its background, or with it where the options keep it, and a sentence on what was done.
  /// Transparent black outside the object; reduced to 1024 pixels where a background was removed.
  io::Image object_of(const InputPicture& picture, std::vector<std::string>& notices);

 private:
  /// A picture of normals as large as `object`; nothing for NormalSource::kColors.
  std::optional<io::Image> normals_of(const InputPicture& picture, const InputPicture* normal_map,
                                      const io::Image& object, std::vector<std::string>& notices);

  PreprocessingOptions options_;
  std::shared_ptr<vision::NormalEstimator> estimator_;
  std::unique_ptr<MattingNetwork> network_;  // either this
  std::unique_ptr<TrainedMatting> trained_;  // or that one
};

}  // namespace anigen::generate
