#pragma once
#include <functional>
#include <optional>
#include <vector>

#include "anigen/eval/align/similarity.h"
#include "anigen/io/image.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::eval {

/// The cameras of the picture metrics (reference training-and-data.md, 7.5): yaw 0, 90, 180, 270°, pitch 0, at distance
/// 2 from the origin and looking at it, 40° field of view, 512² pixels, black background. Colours are those of the
/// asset under the soft light that raytrace::render uses, without shadows; 4 rays per pixel.
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

/// A learned distance between two pictures (LPIPS), which comes from where the network lives.
using PerceptualDistance = std::function<double(const io::Image&, const io::Image&)>;

/// A ratio beyond this says only that pictures agree to within single grey levels; equal pictures, whose ratio is
/// infinite, count as this.
inline constexpr double kLargestPsnr = 100.0;

struct ImageScores {
  double psnr = 0.0;  ///< dB, at most kLargestPsnr per view
  double ssim = 0.0;
  std::optional<double> lpips;  ///< absent: not computed
};

/// Means over the views. @throws InputError when there is no view or the lists differ in length or picture size
ImageScores image_scores(const std::vector<io::Image>& prediction, const std::vector<io::Image>& truth,
                         const PerceptualDistance& perceptual = nullptr);

}  // namespace anigen::eval
