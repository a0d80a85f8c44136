#pragma once
#include <array>
#include <filesystem>
#include <vector>

#include "anigen/core/random.h"

namespace anigen::loaders {

/// One rendered view with its camera: the image pack of AniGenSparseFeat2Skeleton.
struct ViewImage {
  std::vector<float> image;            ///< [3, S, S] colour in [0, 1], not multiplied by alpha
  std::vector<float> alpha;            ///< [S, S] in [0, 1]
  std::array<float, 16> extrinsics{};  ///< [4, 4] row-major, world → camera, OpenCV axes
  std::array<float, 9> intrinsics{};   ///< [3, 3] row-major, normalised: a picture spans [0, 1]²
};

/// A random frame of `<folder>/transforms.json`, resized to size × size by Lanczos; colours and alpha each on their
/// own, so that colours of transparent pixels count (reference training-and-data.md, 1.4, image pack).
/// @param folder renders/<id> @throws InputError naming the file: no frames, a picture that is missing or broken
ViewImage read_view(const std::filesystem::path& folder, int size, Rng& rng);

/// Which pictures of a view condition a model.
enum class ConditionPictures {
  kColor,  ///< NNN.png: what the published training data holds
  /// NNN_normal.png: normals in the camera's frame as the published normal estimator gives them, x negated, mapped to
  /// [0, 1], what the published pipeline shows its first stage (reference training-and-data.md, 3.4, conditioning
  /// mismatch). anigen-prepare --view-geometry writes them.
  kNormals
};

/// A random frame, cropped around the object, on black: [3, S, S] in [0, 1]. See io/image_crop.h. Normal pictures have
/// the alpha of the colour pictures, so both are cropped and masked alike.
/// @param folder renders_cond/<id> @throws InputError as read_view, and for a view without an object
std::vector<float> read_condition_image(const std::filesystem::path& folder, int size, Rng& rng,
                                        ConditionPictures pictures = ConditionPictures::kColor);

/// Where the normals of a view lie, if there are any: "007.png" has them in "007_normal.png".
std::filesystem::path normal_picture_of(const std::filesystem::path& color);

/// The picture of normals of the first frame, to see before training whether an asset has them.
/// @throws InputError naming the file when there is none
std::filesystem::path first_normal_picture(const std::filesystem::path& folder);

}  // namespace anigen::loaders
