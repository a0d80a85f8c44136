#pragma once
#include <functional>
#include <optional>
#include <vector>

#include "anigen/io/image.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "anigen/metrics/similarity.h"

namespace anigen::metrics {

/// Peak signal-to-noise ratio in decibels, 10 log10(1 / mean squared difference), over all pixels and the three colour
/// channels as numbers in [0, 1]; alpha is ignored. Infinite for equal pictures.
/// @throws InputError when the sizes differ or a picture is empty
double psnr(const io::Image& a, const io::Image& b);

/// Structural similarity (Wang, Bovik, Sheikh, Simoncelli 2004), in [-1, 1], 1 for equal pictures: 11 × 11 Gaussian
/// window of standard deviation 1.5 with weights that sum to 1, K1 = 0.01, K2 = 0.03, dynamic range 1, variances
/// weighted by the window (not the unbiased ones). Averaged over the positions where the whole window lies inside the
/// picture, then over the three colour channels, as numbers in [0, 1]; alpha is ignored.
/// @throws InputError when the sizes differ or a side is shorter than 11 pixels
double ssim(const io::Image& a, const io::Image& b);

/// The cameras of the picture metrics (docs/reference/training.md, 7.5): yaw 0, 90, 180, 270°, pitch 0, at distance 2
/// from the origin and looking at it, 40° field of view, 512² pixels, black background. Colours are those of the asset
/// under the soft light that render::render uses, without shadows; 4 rays per pixel.
struct ViewOptions {
  int views = 4;
  int size = 512;  ///< pixels on a side
  double distance = 2.0, fov_degrees = 40.0, pitch_degrees = 0.0;
};

/// Pictures of a shape after a similarity has moved it into the frame of scores. What lies outside the frame is cut
/// off.
/// @throws InputError when the mesh has no faces or is malformed, a texture cannot be decoded, or an option is out of
/// range
std::vector<io::Image> render_views(const io::RiggedShape& shape, const Similarity& placement,
                                    const ViewOptions& options = {});

/// A learned distance between two pictures, which comes from where the network lives.
using PerceptualDistance = std::function<double(const io::Image&, const io::Image&)>;

/// Learned distances between pictures; unset: not computed.
struct PerceptualDistances {
  PerceptualDistance lpips;
  PerceptualDistance encoder;  ///< of the tokens that a trained image encoder gives
};

/// A ratio beyond this says only that pictures agree to within single grey levels; equal pictures, whose ratio is
/// infinite, count as this.
inline constexpr double kLargestPsnr = 100.0;

struct ImageScores {
  double psnr = 0.0;  ///< dB, at most kLargestPsnr per view
  double ssim = 0.0;
  std::optional<double> lpips, encoder;  ///< absent: not computed
};

/// Means over the views. @throws InputError when there is no view or the lists differ in length or picture size
ImageScores image_scores(const std::vector<io::Image>& prediction, const std::vector<io::Image>& truth,
                         const PerceptualDistances& perceptual = {});

}  // namespace anigen::metrics
