#include "anigen/raster/rasterize.h"

#include <cmath>
#include <string>

#include "anigen/core/error.h"
#include "anigen/raster/check_inputs.h"
#include "anigen/raster/pixel_triangle.h"
#include "anigen/raster/vertex_sums.h"
#include "anigen/raster/visibility.h"

namespace anigen::raster {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

constexpr std::int64_t kGrainPixels = 4096;

void check_viewport(const Viewport& viewport) {
  if (viewport.height < 1 || viewport.width < 1 || viewport.height > kMostPixelsPerSide ||
      viewport.width > kMostPixelsPerSide) {
    throw InputError("", "size",
                     "a picture of " + std::to_string(viewport.height) + " x " + std::to_string(viewport.width) +
                         " pixels; each side must have 1 to " + std::to_string(kMostPixelsPerSide));
  }
  if (viewport.subpixel_bits < 1 || viewport.subpixel_bits > kMostSubpixelBits) {
    throw InputError("", "subpixel_bits",
                     std::to_string(viewport.subpixel_bits) + " is not in 1 … " + std::to_string(kMostSubpixelBits));
  }
}

void check_finite(const Tensor& clip) {
  const double* values = clip.data_ptr<double>();
  for (std::int64_t i = 0; i < clip.numel(); ++i) {
    if (!std::isfinite(values[i])) throw InputError("", "vertex " + std::to_string(i / 4), "is not finite");
  }
}

// Barycentrics of what is visible, and depth 0 for the background.
void resolve(const Viewport& viewport, const double* clip, const std::int64_t* faces, const std::int64_t* triangle,
             double* barycentric, double* depth) {
  at::parallel_for(0, viewport.height * viewport.width, kGrainPixels, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t pixel = begin; pixel < end; ++pixel) {
      if (triangle[pixel] == 0) {
        depth[pixel] = barycentric[2 * pixel] = barycentric[2 * pixel + 1] = 0.0;
        continue;
      }
      const PixelTriangle seen(clip, faces + 3 * (triangle[pixel] - 1), viewport.x(pixel % viewport.width),
                               viewport.y(pixel / viewport.width));
      const auto [u, v] = seen.barycentric();
      barycentric[2 * pixel] = u;
      barycentric[2 * pixel + 1] = v;
    }
  });
}

// Outputs: barycentric, depth, triangle.
class Rasterization : public torch::autograd::Function<Rasterization> {
 public:
  static variable_list forward(AutogradContext* context, const Tensor& clip, const Tensor& faces, std::int64_t height,
                               std::int64_t width, std::int64_t subpixel_bits) {
    RECORD_USER_SCOPE("rasteriser: rasterisation");
    const Viewport viewport{height, width, subpixel_bits};
    const Tensor positions = clip.to(torch::kFloat64).contiguous();
    check_finite(positions);
    const Tensor depth = torch::empty({height, width}, torch::kFloat64);
    const Tensor barycentric = torch::empty({height, width, 2}, torch::kFloat64);
    const Tensor triangle = torch::empty({height, width}, torch::kInt64);
    const double* points = positions.data_ptr<double>();
    const std::int64_t* corners = faces.data_ptr<std::int64_t>();
    find_visible(viewport, points, corners, faces.size(0), depth.data_ptr<double>(), triangle.data_ptr<std::int64_t>());
    resolve(viewport, points, corners, triangle.data_ptr<std::int64_t>(), barycentric.data_ptr<double>(),
            depth.data_ptr<double>());
    const Tensor depth_out = depth.to(nn::dtype_of(clip));
    context->save_for_backward({clip, faces, triangle});
    context->mark_non_differentiable({depth_out, triangle});
    return {barycentric.to(nn::dtype_of(clip)), depth_out, triangle};
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("rasteriser: rasterisation");
    TORCH_CHECK(!at::GradMode::is_enabled(), "rasterisation can be differentiated once only");
    const variable_list saved = context->get_saved_variables();
    const Tensor &clip = saved[0], &faces = saved[1], &triangle = saved[2];
    const Viewport viewport{triangle.size(0), triangle.size(1)};
    const Tensor positions = clip.to(torch::kFloat64).contiguous();
    const Tensor slopes = gradients[0].to(torch::kFloat64).contiguous();
    const Tensor sums = torch::zeros({clip.size(0), 4}, torch::kFloat64);
    const double *points = positions.data_ptr<double>(), *slope = slopes.data_ptr<double>();
    const std::int64_t *corners = faces.data_ptr<std::int64_t>(), *id = triangle.data_ptr<std::int64_t>();
    double* sum = sums.data_ptr<double>();
    const auto corners_of = [&](std::int64_t pixel) -> const std::int64_t* {
      const bool none = id[pixel] == 0 || (slope[2 * pixel] == 0.0 && slope[2 * pixel + 1] == 0.0);
      return none ? nullptr : corners + 3 * (id[pixel] - 1);
    };
    const auto add = [&](std::int64_t pixel, const std::int64_t* vertices, const VertexShare& share) {
      const double x = viewport.x(pixel % viewport.width), y = viewport.y(pixel / viewport.width);
      const auto moved = PixelTriangle(points, vertices, x, y).gradients(x, y, slope[2 * pixel], slope[2 * pixel + 1]);
      for (std::size_t k = 0; k < 3; ++k) {
        if (!share.owns(vertices[k])) continue;
        double* to = sum + 4 * vertices[k];
        to[0] += moved[k][0];
        to[1] += moved[k][1];
        to[3] += moved[k][2];
      }
    };
    sum_by_vertex(triangle.numel(), corners_of, add);
    return {sums.to(nn::dtype_of(clip)), Tensor(), Tensor(), Tensor(), Tensor()};
  }
};

}  // namespace

Fragments rasterize(const Tensor& clip, const Tensor& faces, std::int64_t height, std::int64_t width,
                    std::int64_t subpixel_bits) {
  check_clip(clip);
  check_viewport({height, width, subpixel_bits});
  const Tensor corners = checked_faces(faces, clip.size(0), "faces");
  const variable_list seen = Rasterization::apply(clip.to(torch::kCPU), corners, height, width, subpixel_bits);
  return {seen[0].to(clip.device()), seen[1].to(clip.device()), seen[2].to(clip.device())};
}

}  // namespace anigen::raster
