#pragma once
#include <filesystem>
#include <string>

#include "anigen/io/arrays/ndarray.h"
#include "anigen/nn/torch.h"
#include "anigen/vision/dsine_network.h"

namespace anigen::vision {

/// A pinhole camera, in pixels. The centre of the pixel in row i and column j is (j + 0.5, i + 0.5); X points right, Y
/// down, Z into the picture.
struct PinholeCamera {
  double focal_u = 0.0, focal_v = 0.0;
  double center_u = 0.0, center_v = 0.0;

  /// 60° across the longer side, looking through the middle (docs/reference/normals.md, 2).
  static PinholeCamera of_picture(std::int64_t height, std::int64_t width);
  /// The camera of the picture with so many columns added at its left and rows at its top.
  PinholeCamera padded(std::int64_t left, std::int64_t top) const;
  /// The camera of the picture reduced to 1 / factor of its height and width.
  PinholeCamera reduced(std::int64_t factor) const;

  /// (focal_u, focal_v) and (center_u, center_v) as [1, 2, 1, 1], dtype and device of `like`.
  Tensor focal(const Tensor& like) const;
  Tensor center(const Tensor& like) const;
};

/// v / max(‖v‖, 1e-12) over axis 1.
Tensor unit_vectors(const Tensor& v);

/// Pixel centres, (j + 0.5, i + 0.5). @return [1, 2, rows, columns], dtype and device of `like`
Tensor pixel_centers(std::int64_t rows, std::int64_t columns, const Tensor& like);

/// The rays through pixels, as (x / z, y / z). @return [1, 2, rows, columns], dtype and device of `like`
Tensor ray_slopes(const PinholeCamera& camera, std::int64_t rows, std::int64_t columns, const Tensor& like);

/// Unit vectors along the rays. @param slopes [1, 2, H, W] @return [1, 3, H, W]
Tensor unit_rays(const Tensor& slopes);

/// The ray ReLU of DSINE (Bae and Davison 2024, "Rethinking Inductive Biases for Surface Normal Estimation", section 3;
/// docs/reference/normals.md, 5): what is seen faces the camera, so the component of a normal along the ray, with
/// normals pointing away from the camera, is raised to at least 0.01, and the normal made unit again.
/// @param normals [B, 3, ...] @param rays unit, broadcast to the same shape
Tensor ray_relu(const Tensor& normals, const Tensor& rays);

inline constexpr int kDsineIterations = 5;                 ///< refinements, as published
inline constexpr std::int64_t kDsinePictureMultiple = 32;  ///< of height and width of what the network sees

/// Input of the refinement, at an eighth of the size: h = H / 8, w = W / 8.
struct DsineState {
  PinholeCamera camera;  ///< of this grid
  Tensor slopes, rays;   ///< [B, 2, h, w], [1, 3, h, w] unit: through the pixels of the grid
  Tensor input;          ///< [B, 66, h, w], features and slopes: the same in every iteration
  Tensor hidden;         ///< [B, 64, h, w]
  Tensor normals;        ///< [B, 3, h, w], unit
};

/// DSINE (Bae and Davison 2024, "Rethinking Inductive Biases for Surface Normal Estimation";
/// docs/reference/normals.md): an encoder, a decoder, and a recurrent unit that refines normals at an eighth of the
/// size by turning those of neighbouring pixels. Evaluation only, under torch::NoGradGuard; fp32, or fp64 after
/// to(kFloat64).
///
/// 72.6 million parameters in 570 tensors, and 348 buffers. Keys as released: `encoder.original_model.*`, `decoder.*`,
/// `gru.*`, `prob_head.*`, `xy_head.*`, `angle_head.*`, `up_prob_head.*`. The constructor reserves memory and writes
/// nothing but the affine maps of group norms: fill it with load_dsine (dsine_weights() below).
class DsineImpl : public torch::nn::Module {
 public:
  DsineImpl();

  /// @param images [B, 3, H, W] in ImageNet's normalisation (imagenet_normalized), H and W multiples of 32
  /// @param camera of these pictures, padding included
  /// @param iterations refinements; 0: what the decoder says, upsampled
  /// @return [B, 3, H, W] unit normals, pointing away from the camera: X right, Y down, Z forward
  Tensor forward(const Tensor& images, const PinholeCamera& camera, int iterations = kDsineIterations);

  /// The steps of forward.
  EncoderMaps encode(const Tensor& images);
  /// @param camera of the pictures that were encoded
  DsineState begin(const EncoderMaps& maps, const PinholeCamera& camera);
  void refine(DsineState& state);
  /// @return [B, 3, H, W] unit normals
  Tensor upsampled(const DsineState& state);

 private:
  EfficientNetB5 encoder_ = nullptr;
  NormalDecoder decoder_ = nullptr;
  ConvGru gru_ = nullptr;
  PredictionHead prob_head_ = nullptr, xy_head_ = nullptr, angle_head_ = nullptr, up_prob_head_ = nullptr;
};
TORCH_MODULE(Dsine);

/// The (2 radius + 1)² pixels around every pixel, row by row from the upper left; beyond the border the nearest pixel
/// of the border. @param x [B, C, H, W] @return [B, C, (2 radius + 1)², H, W]
Tensor neighborhood(const Tensor& x, std::int64_t radius);

/// Axes to turn normals about: the direction in the plane perpendicular to a normal which, seen from the camera at the
/// place of the normal, points along a direction of the picture. 0 where there is none, as where the plane is seen
/// edge-on (docs/reference/normals.md, 6).
/// @param normals [B, 3, K, H, W] unit @param directions [B, 2, K, H, W] unit, pixels right and down
/// @param places [1, 2, K, H, W] where the normals are, in pixels @return [B, 3, K, H, W], unit or 0
Tensor rotation_axes(const Tensor& normals, const Tensor& directions, const Tensor& places,
                     const PinholeCamera& camera);

/// Turned by angles in radians, right-handed (Rodrigues' formula); as they are where the axis is 0.
/// @param vectors, axes [B, 3, ...] @param angles [B, 1, ...]
Tensor rotated(const Tensor& vectors, const Tensor& axes, const Tensor& angles);

/// Prediction of the refinement for each of the K = 25 pixels around every pixel.
struct NeighborRotations {
  Tensor weights;     ///< [B, K, H, W], not negative; they need not sum to 1
  Tensor directions;  ///< [B, 2, K, H, W] of the axis in the picture, unit
  Tensor angles;      ///< [B, K, H, W], radians
};

/// One step of DSINE (Bae and Davison 2024, section 3; docs/reference/normals.md, 6): the normals around a pixel, each
/// turned, made to face this pixel's ray, weighted, summed and made unit.
/// @param normals [B, 3, H, W] unit @param camera of this grid @param rays [1, 3, H, W] unit
Tensor propagated_normals(const Tensor& normals, const NeighborRotations& rotations, const PinholeCamera& camera,
                          const Tensor& rays);

/// Zeros around a picture that make height and width multiples of 32, as evenly as whole pixels allow.
struct PicturePadding {
  std::int64_t left = 0, right = 0, top = 0, bottom = 0;
};
PicturePadding dsine_padding(std::int64_t height, std::int64_t width);

/// The normals of a picture as the published pipeline asks DSINE for them (docs/reference/normals.md, 2): black around
/// the picture before ImageNet's normalisation, a camera of 60° across the longer side of the picture without padding,
/// the padding cut off again.
/// @param rgb [B, 3, H, W] in [0, 1], converted to dtype and device of the network
/// @return [B, 3, H, W] unit normals, pointing away from the camera: X right, Y down, Z forward
Tensor picture_normals(Dsine& network, const Tensor& rgb, int iterations = kDsineIterations);

/// Fills the network. Accepted are the arrays of the released file, whose state dict stands under `model` (then every
/// other key is left alone), and a bare state dict; either with or without `module.` before its keys, and with or
/// without the counters `num_batches_tracked`, which have no influence.
/// @param file for messages
/// @throws InputError naming the key: missing or unexpected keys, another shape (both named), values that are not
///   finite, whole numbers where weights belong; the network is then unchanged
void set_dsine_weights(Dsine& network, io::NamedArrays arrays, const std::string& file);

/// DSINE with the weights of a `.pt`, `.pth` or `.safetensors` file, on the CPU.
///
/// The released weights (`dsine.pt`, about 291 MB) are not part of this project and are not ours to pass on: users
/// bring their own copy. They are published for non-commercial research (Imperial College London's licence of DSINE),
/// and what is made with them should be treated the same way (docs/reference/normals.md, 1).
/// @throws InputError as set_dsine_weights, and for files that cannot be read
Dsine load_dsine(const std::filesystem::path& file);

/// Estimator of the surface normals that an image shows (docs/reference/normals.md, 2).
class NormalEstimator {
 public:
  virtual ~NormalEstimator() = default;

  /// @param rgb [1, 3, H, W] fp32 in [0, 1]: the whole picture, neither cropped nor resized, its background still there
  /// @return [1, 3, H, W] fp32, of unit length; camera frame: X right, Y down, Z forward, pointing away from the camera
  /// (a wall that faces the camera is (0, 0, 1))
  /// @throws InputError when the picture is larger than the estimator can hold
  virtual torch::Tensor normals(const torch::Tensor& rgb) = 0;
};

/// The largest picture, its height and width rounded up to multiples of 32: 4096 × 4096.
inline constexpr std::int64_t kMostNormalPixels = std::int64_t{1} << 24;

/// Normals as the published pipeline estimates them: DSINE on the whole picture (dsine_network.h). Memory on a
/// CPU, measured up to 2048 × 2048: 0.8 GB and 230 bytes for every pixel, which makes 4.7 GB for the largest picture.
///
/// The released weights are not part of this project: users supply their own copy, for non-commercial research only
/// (vision/dsine.h).
class DsineNormals : public NormalEstimator {
 public:
  /// @param weights `dsine.pt`, or the same tensors as .safetensors @throws InputError as vision::load_dsine
  explicit DsineNormals(const std::filesystem::path& weights, const torch::Device& device = torch::kCPU);
  /// A network that is filled already, where it is.
  explicit DsineNormals(Dsine network);

  /// @throws InputError for a picture of more than kMostNormalPixels
  torch::Tensor normals(const torch::Tensor& rgb) override;

 private:
  Dsine network_;
};

}  // namespace anigen::vision
