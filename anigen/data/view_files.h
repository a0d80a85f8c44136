#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/core/random.h"
#include "anigen/data/metadata.h"
#include "anigen/io/arrays/ndarray.h"
#include "anigen/io/image.h"

namespace anigen::data {

/// One rendered view with its camera: the image pack of AniGenSparseFeat2Skeleton.
struct ViewImage {
  std::vector<float> image;            ///< [3, S, S] colour in [0, 1], not multiplied by alpha
  std::vector<float> alpha;            ///< [S, S] in [0, 1]
  std::array<float, 16> extrinsics{};  ///< [4, 4] row-major, world → camera, OpenCV axes
  std::array<float, 9> intrinsics{};   ///< [3, 3] row-major, normalised: a picture spans [0, 1]²
};

/// A random frame of `<folder>/transforms.json`, resized to size × size by Lanczos; colours and alpha each on their
/// own, so that colours of transparent pixels count (docs/reference/training.md, 1.3).
/// @param folder renders/<id> @throws InputError naming the file: no frames, a picture that is missing or broken
ViewImage read_view(const std::filesystem::path& folder, int size, Rng& rng);

/// Kind of image of a view that conditions a model.
enum class ConditionPictures {
  kColor,  ///< NNN.png: what the published training data holds
  /// NNN_normal.png: normals in the camera's frame as the published normal estimator gives them, x negated, mapped to
  /// [0, 1], what the published pipeline shows its first stage (docs/reference/training.md, 3.6). anigen-prepare
  /// --view-geometry writes them.
  kNormals
};

/// Folder of the condition views of an asset, renders_cond/<id>.
std::filesystem::path condition_folder(const AssetId& asset);

/// A random frame, cropped around the object (io::condition_box), with its alpha.
/// @throws InputError as read_condition_image
io::Image read_condition_view(const std::filesystem::path& folder, Rng& rng,
                              ConditionPictures pictures = ConditionPictures::kColor);

/// A random frame, cropped around the object, on black: [3, S, S] in [0, 1]. See io/image_resize.h. Normal pictures
/// have the alpha of the colour pictures, so both are cropped and masked alike.
/// @param folder renders_cond/<id> @throws InputError as read_view, and for a view without an object
std::vector<float> read_condition_image(const std::filesystem::path& folder, int size, Rng& rng,
                                        ConditionPictures pictures = ConditionPictures::kColor);

/// File names of the colour pictures of `<folder>/transforms.json`, in the order that a random frame is chosen by.
/// @throws InputError as read_view
std::vector<std::string> condition_views(const std::filesystem::path& folder);

/// One view, cropped around the object and resized with its alpha: what read_condition_image() puts on black.
/// @param color file of the colour picture @return RGBA, size × size @throws InputError as read_condition_image
io::Image condition_picture(const std::filesystem::path& color, int size, ConditionPictures pictures);

/// Colours times alpha, [3, H, W] in [0, 1].
std::vector<float> planes_on_black(const io::Image& picture);

/// File of the normals of a view, if there are any: "007.png" has them in "007_normal.png".
std::filesystem::path normal_picture_of(const std::filesystem::path& color);

/// The picture of normals of the first frame, to see before training whether an asset has them.
/// @throws InputError naming the file when there is none
std::filesystem::path first_normal_picture(const std::filesystem::path& folder);

/// Rows whose largest weight is exactly 0 get weight 1 on joint 0; then each row is divided by its sum
/// (docs/reference/training.md, 1.3). @param skin [V, J] row-major, finite, ≥ 0
/// @return how many rows had no weight
std::size_t normalize_skin_rows(std::vector<float>& skin, std::size_t joints);

/// `skin_accum_as_flow`: replaces each joint's column by the sum over its subtree, from the first root downwards,
/// clipped to [0, 1]. Joints that do not hang from the first root keep their own weights, clipped too.
/// @param skin [V, J] row-major @param parents [J], -1 for a root, no cycles
void accumulate_skin_as_flow(std::vector<float>& skin, const std::vector<int>& parents);

/// `skeleton/<id>/skeleton_voxelized.npz` as stored (docs/reference/training.md, 1.1): world frame, in [-0.5, 0.5]³.
struct RigArrays {
  std::vector<Eigen::Vector3f> joints;     ///< [J], J ≥ 1
  std::vector<int> parents;                ///< [J], -1 for a root; no cycles, otherwise in any order
  std::vector<Eigen::Vector3f> vertices;   ///< [V]
  std::vector<Triangle> faces;             ///< [F], F > 0
  io::Dtype face_dtype = io::Dtype::kI64;  ///< of `faces` in the file
  std::vector<float> skin;                 ///< [V, J] row-major, finite, ≥ 0; rows need not sum to 1
};

/// @throws InputError naming file, array and index: missing arrays, wrong shapes, numbers that are not finite, negative
/// weights, parents or faces out of range, cycles, more than max_joints joints, sizes beyond reason
RigArrays read_rig_arrays(const AssetId& asset, std::size_t max_joints = 4096);

/// The file read_rig_arrays reads.
std::filesystem::path rig_path(const AssetId& asset);

}  // namespace anigen::data
